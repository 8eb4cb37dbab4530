//! Suspensory ligaments: rows of tension-only cables from the rear of the breast to the muscle.
//!
//! Each cable ties one node of the breast's rear to an anchor on the chest wall that lies farther
//! from the breast's centre, so that it resists motion towards the centre and goes slack in
//! motion away from it. The four ligaments are the four sectors of the rim of the base
//! (Mîra 2018, § 1.1.3 and § 3.4; the thesis modelled two of them).

use super::anatomy::Anatomy;
use mammotwin_data::{
    Vec3,
    mesh::{Patch, TetMesh},
    study::InterfaceRegion,
    surface::TriMesh,
};

/// Distance (mm) from a node to its anchor when the cable is just taut.
pub const LENGTH_MM: f64 = 10.0;
/// Thickness (mm) of a ligament's sheet; cables share it by the length of rim that they hold.
const SHEET_MM: f64 = 1.0;
/// The rim: elliptic radii between which a node belongs to a ligament.
const RIM: [f64; 2] = [0.85, 1.2];

/// A suspensory ligament of the breast.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ligament {
    /// Along the inframammary fold.
    Inframammary,
    /// Along the sternum.
    DeepMedial,
    /// Along the upper rim.
    Cranial,
    /// Along the lateral rim.
    Lateral,
}

impl Ligament {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Inframammary, Self::DeepMedial, Self::Cranial, Self::Lateral];

    /// Word in study files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Inframammary => "inframammary",
            Self::DeepMedial => "deep_medial",
            Self::Cranial => "cranial",
            Self::Lateral => "lateral",
        }
    }

    /// The ligament of a word.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|ligament| ligament.name() == name)
    }

    /// The region of the chest wall that it holds.
    fn region(self) -> InterfaceRegion {
        match self {
            Self::Inframammary => InterfaceRegion::Inframammary,
            Self::DeepMedial => InterfaceRegion::DeepMedial,
            Self::Cranial => InterfaceRegion::Cranial,
            Self::Lateral => InterfaceRegion::Lateral,
        }
    }

    /// The sector of the rim that elliptic coordinates (lateral, cranial) lie in.
    fn of_sector([lateral, cranial]: [f64; 2]) -> Self {
        if cranial.abs() >= lateral.abs() {
            if cranial < 0.0 { Self::Inframammary } else { Self::Cranial }
        } else if lateral < 0.0 {
            Self::DeepMedial
        } else {
            Self::Lateral
        }
    }
}

/// Region of the chest wall that a point (mm) of the reference pose belongs to, if any.
pub fn region(anatomy: &Anatomy, point: &Vec3) -> Option<InterfaceRegion> {
    let (base, radius) = anatomy.nearest(point)?;
    if radius < RIM[0] {
        Some(InterfaceRegion::Base)
    } else if radius <= RIM[1] {
        Some(Ligament::of_sector(base.elliptic(point)).region())
    } else {
        None
    }
}

/// One cable.
#[derive(Debug, Clone, PartialEq)]
pub struct CablePlan {
    /// Node of the mesh.
    pub node: u32,
    /// Fixed end (mm).
    pub anchor: Vec3,
    /// Cross-section (mm²).
    pub section_mm2: f64,
}

/// The cables of the ligaments in `names`, each with its ligament. Which nodes they hold is seen in the reference pose
/// (the points of `mesh`); they are just taut in the stress-free shape `rest`.
pub fn cables(
    mesh: &TetMesh,
    rest: &[Vec3],
    anatomy: &Anatomy,
    names: &[Ligament],
) -> Vec<(Ligament, CablePlan)> {
    let wall = TriMesh { points: rest.to_vec(), ..mesh.patch_surface(Patch::ChestWall) };
    let normals = wall.vertex_normals();
    let mut area = vec![0.0; mesh.points.len()];
    for t in 0..wall.triangles.len() {
        for n in wall.triangles[t] {
            area[n as usize] += wall.area_vector(t).norm() / 3.0;
        }
    }
    let mut cables = Vec::new();
    for node in mesh.patch_nodes(Patch::ChestWall) {
        let p = mesh.points[node as usize];
        let Some((base, radius)) = anatomy.nearest(&p) else { continue };
        let ligament = Ligament::of_sector(base.elliptic(&p));
        if !(RIM[0]..=RIM[1]).contains(&radius) || !names.contains(&ligament) {
            continue;
        }
        let normal = normals[node as usize];
        let away = p - base.center;
        let Some(outward) = (away - normal * away.dot(&normal)).try_normalize(1e-6) else {
            continue;
        };
        // A node stands for its area of rim; over the rim's width that is a length.
        let half_axis = 0.5 * (base.half_axes_mm[0] + base.half_axes_mm[1]);
        let rim_length = area[node as usize] / (half_axis * (RIM[1] - RIM[0]));
        let anchor = rest[node as usize] + LENGTH_MM * outward;
        let cable = CablePlan { node, anchor, section_mm2: SHEET_MM * rim_length };
        cables.push((ligament, cable));
    }
    cables
}

/// Nodes that two patches share: the end of one at the other.
pub fn shared_nodes(mesh: &TetMesh, one: Patch, other: Patch) -> Vec<u32> {
    let others = mesh.patch_nodes(other);
    mesh.patch_nodes(one).into_iter().filter(|n| others.binary_search(n).is_ok()).collect()
}

/// Cables that hold the fascia at the midaxillary cuts, where it goes on to the back
/// (Mîra 2018, § 3.4).
pub fn lateral_cables(mesh: &TetMesh, rest: &[Vec3]) -> Vec<CablePlan> {
    let wall = TriMesh { points: rest.to_vec(), ..mesh.patch_surface(Patch::ChestWall) };
    let normals = wall.vertex_normals();
    let mut cables = Vec::new();
    for cut in [Patch::LateralRight, Patch::LateralLeft] {
        let ends = shared_nodes(mesh, Patch::ChestWall, cut);
        let z = |n: &u32| mesh.points[*n as usize].z;
        let low = ends.iter().map(z).fold(f64::INFINITY, f64::min);
        let high = ends.iter().map(z).fold(f64::NEG_INFINITY, f64::max);
        let length = (high - low) / ends.len().max(1) as f64;
        for node in ends {
            let (p, normal) = (rest[node as usize], normals[node as usize]);
            let back = -Vec3::y();
            let Some(along) = (back - normal * back.dot(&normal)).try_normalize(1e-6) else {
                continue;
            };
            let section_mm2 = SHEET_MM * length;
            cables.push(CablePlan { node, anchor: p + LENGTH_MM * along, section_mm2 });
        }
    }
    cables
}
