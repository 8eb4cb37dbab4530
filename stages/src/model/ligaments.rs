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

#[cfg(test)]
mod tests {
    use super::super::{BreastBase, recipe};
    use super::*;
    use mammotwin_data::labels::Side;
    use mammotwin_solver::terms::Cables;

    const HALF_MM: f64 = 60.0;

    /// A right breast's base on the plane y = 0, 60 mm to each rim.
    fn anatomy() -> Anatomy {
        let base = BreastBase {
            side: Side::Right,
            center: Vec3::zeros(),
            lateral: Vec3::x(),
            cranial: Vec3::z(),
            normal: Vec3::y(),
            half_axes_mm: [HALF_MM, HALF_MM],
            nipple: 50.0 * Vec3::y(),
            projection_mm: 50.0,
        };
        Anatomy { sternum_x_mm: -80.0, breasts: vec![base] }
    }

    /// The wall around it: a grid of 4 mm.
    fn wall() -> TetMesh {
        let count = 51u32;
        let at = |n: u32| 4.0 * (f64::from(n) - 25.0);
        let points = (0..count).flat_map(|i| (0..count).map(move |j| (i, j)));
        let points = points.map(|(i, j)| Vec3::new(at(i), 0.0, at(j))).collect();
        let mut faces = Vec::new();
        for i in 0..count - 1 {
            for j in 0..count - 1 {
                let [a, b, c, d] =
                    [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)].map(|(i, j)| i * count + j);
                faces.extend([[a, b, c], [a, c, d]]);
            }
        }
        let mut mesh = TetMesh { points, ..TetMesh::default() };
        mesh.patches.insert(Patch::ChestWall, faces);
        mesh
    }

    fn place(lateral: f64, cranial: f64) -> Vec3 {
        HALF_MM * Vec3::new(lateral, 0.0, cranial)
    }

    #[test]
    fn every_ligament_has_its_word_and_its_sector() {
        for ligament in Ligament::ALL {
            assert_eq!(Ligament::from_name(ligament.name()), Some(ligament));
        }
        assert_eq!(Ligament::from_name("cooper"), None);
        for (lateral, cranial, want) in [
            (0.0, -1.0, Ligament::Inframammary),
            (0.0, 1.0, Ligament::Cranial),
            (-1.0, 0.0, Ligament::DeepMedial),
            (1.0, 0.0, Ligament::Lateral),
            // Sectors meet on the diagonals.
            (0.69, -0.70, Ligament::Inframammary),
            (0.70, -0.69, Ligament::Lateral),
            (-0.70, 0.69, Ligament::DeepMedial),
            (-0.69, 0.70, Ligament::Cranial),
        ] {
            assert_eq!(Ligament::of_sector([lateral, cranial]), want, "{lateral} {cranial}");
            assert_eq!(region(&anatomy(), &place(lateral, cranial)), Some(want.region()));
        }
        assert_eq!(region(&anatomy(), &place(0.5, 0.5)), Some(InterfaceRegion::Base));
        assert_eq!(region(&anatomy(), &place(0.0, 0.84)), Some(InterfaceRegion::Base));
        assert_eq!(region(&anatomy(), &place(0.9, 0.9)), None);
    }

    #[test]
    fn a_ligament_holds_the_nodes_of_its_sector_of_the_rim() {
        let (mesh, anatomy) = (wall(), anatomy());
        let mut held = Vec::new();
        for ligament in Ligament::ALL {
            let found = cables(&mesh, &mesh.points, &anatomy, &[ligament]);
            assert!(!found.is_empty());
            for (own, cable) in &found {
                let p = mesh.points[cable.node as usize] / HALF_MM;
                assert_eq!(*own, ligament);
                assert!((0.85..=1.2).contains(&p.norm()), "{p}");
                assert_eq!(Ligament::of_sector([p.x, p.z]), ligament);
                held.push(cable.node);
            }
        }
        held.sort_unstable();
        let on_rim = |p: &Vec3| (0.85..=1.2).contains(&(p.norm() / HALF_MM));
        let rim = (0..mesh.points.len()).filter(|&n| on_rim(&mesh.points[n]));
        assert_eq!(held, rim.map(|n| n as u32).collect::<Vec<_>>(), "each node has one ligament");
        assert!(cables(&mesh, &mesh.points, &anatomy, &[]).is_empty());
    }

    #[test]
    fn sections_share_a_sheet_of_1_mm_around_the_base() {
        let all = cables(&wall(), &wall().points, &anatomy(), &Ligament::ALL);
        let section: f64 = all.iter().map(|(_, cable)| cable.section_mm2).sum();
        // The circle in the middle of the rim.
        let around = std::f64::consts::TAU * HALF_MM * 0.5 * (0.85 + 1.2);
        assert!((section / (SHEET_MM * around) - 1.0).abs() < 0.03, "{section} for {around} mm²");
    }

    #[test]
    fn cables_are_just_taut_at_rest_and_pull_away_from_the_centre_only() {
        let (mesh, anatomy) = (wall(), anatomy());
        // At rest the body is elsewhere: the anchors go along.
        let rest: Vec<Vec3> = mesh.points.iter().map(|p| p + Vec3::new(3.0, 1.0, -2.0)).collect();
        let found = cables(&mesh, &rest, &anatomy, &Ligament::ALL);
        for (_, cable) in &found {
            let node = cable.node as usize;
            let arm = cable.anchor - rest[node];
            assert!((arm.norm() - LENGTH_MM).abs() < 1e-12);
            assert!((arm.normalize() - mesh.points[node].normalize()).norm() < 1e-12, "{arm}");
        }
        let young = 500.0;
        let tied = found.iter().map(|(_, cable)| recipe::tied(cable, young, 0.0)).collect();
        let tied = Cables::new("ligaments", tied).unwrap();
        // Away (mm) from the centre, and the strain of each cable.
        for (way, strain) in [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.05)] {
            let moved: Vec<Vec3> =
                rest.iter().zip(&mesh.points).map(|(r, p)| r + way * p.normalize()).collect();
            for (tension, (_, cable)) in tied.tensions(&moved).iter().zip(&found) {
                let want = young * cable.section_mm2 * strain;
                // The kink is smooth over a thousandth of the length.
                assert!((tension - want).abs() <= 0.011 * want, "{way}: {tension} for {want}");
            }
        }
        // A slack cable waits for so much more.
        let (_, cable) = &found[0];
        let slack = Cables::new("one", vec![recipe::tied(cable, young, 0.6)]).unwrap();
        let node = cable.node as usize;
        let mut moved = rest.clone();
        moved[node] -= 0.5 * mesh.points[node].normalize();
        assert_eq!(slack.tensions(&moved), [0.0]);
    }
}
