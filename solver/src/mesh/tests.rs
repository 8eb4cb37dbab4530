//! Meshes of bodies with closed forms.

use super::{
    bodies::{Ball, Mound, Torso},
    domain::{Domain, ON_SURFACE_MM, PatchDistances},
    lattice::Placement,
    quality::quality,
    tetrahedralize::{MeshError, Meshing, on_lattice, tetrahedralize},
    topology::{euler_characteristic, face_key, face_neighbors, pinched_nodes},
};
use mammotwin_data::{
    Vec3,
    labels::Tissue,
    mesh::{Patch, TetMesh},
};
use std::f64::consts::PI;

fn mesh(domain: &dyn Domain, size_mm: f64) -> TetMesh {
    tetrahedralize(domain, &Meshing::of_size(size_mm), |_| Tissue::AdiposeRight).unwrap()
}

/// What every mesh of a body without holes must be.
#[track_caller]
fn check(domain: &dyn Domain, mesh: &TetMesh) {
    assert!(mesh.tets.iter().all(|tet| TetMesh::tet_volume(&mesh.points, tet) > 0.0));
    assert_eq!(mesh.tissues.len(), mesh.tets.len());
    let shapes = quality(&mesh.points, &mesh.tets).summary;
    assert_eq!((shapes.over_075, shapes.over_095), (0, 0), "{shapes:?}");
    assert!(shapes.max_aspect_ratio < 20.0 && shapes.max_angle_deg < 165.0, "{shapes:?}");
    assert_eq!(euler_characteristic(&mesh.tets), 1);
    let (_, outer) = face_neighbors(&mesh.tets);
    assert!(pinched_nodes(&outer).is_empty());

    let mut in_patches: Vec<_> = mesh.patches.values().flatten().copied().collect();
    let mut on_outside: Vec<_> = outer.iter().map(|face| face.corners).collect();
    in_patches.sort_unstable_by_key(face_key);
    on_outside.sort_unstable_by_key(face_key);
    assert_eq!(in_patches, on_outside, "patches cover the outer faces once, outward");
    let surface = mesh.outer_surface();
    assert!((surface.volume_mm3() / mesh.volume_mm3() - 1.0).abs() < 1e-9);

    for (&patch, faces) in &mesh.patches {
        assert!(!faces.is_empty());
        let mut off: Vec<f64> = mesh
            .patch_nodes(patch)
            .iter()
            .map(|&n| domain.distances(&mesh.points[n as usize]).of(patch).abs())
            .collect();
        off.sort_unstable_by(f64::total_cmp);
        let worst = off[off.len() - 1];
        assert!(worst < ON_SURFACE_MM, "{patch:?}: a node is {worst} mm off its surface");
        assert_eq!(parts(faces), 1, "{patch:?} hangs together");
    }
}

/// Number of parts of a patch that share no edge.
fn parts(faces: &[[u32; 3]]) -> usize {
    let edges = |f: &[u32; 3]| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]];
    let mut by_edge = std::collections::BTreeMap::<[u32; 2], usize>::new();
    for (t, face) in faces.iter().enumerate() {
        by_edge.extend(edges(face).map(|edge| (edge, t)));
    }
    let mut seen = vec![false; faces.len()];
    let mut count = 0;
    for start in 0..faces.len() {
        let mut stack = vec![start];
        count += usize::from(!seen[start]);
        while let Some(t) = stack.pop() {
            if !std::mem::replace(&mut seen[t], true) {
                let neighbors = edges(&faces[t]).map(|[a, b]| by_edge.get(&[b, a]).copied());
                stack.extend(neighbors.iter().flatten());
            }
        }
    }
    count
}

#[test]
fn the_volume_of_a_ball_converges_with_order_two() {
    let exact = 4.0 / 3.0 * PI * 40f64.powi(3);
    let error = |size_mm: f64| {
        let ball = Ball { radius: 40.0 };
        let mesh = mesh(&ball, size_mm);
        check(&ball, &mesh);
        exact - mesh.volume_mm3()
    };
    let (coarse, fine) = (error(10.0), error(5.0));
    let order = (coarse / fine).log2();
    assert!((order - 2.0).abs() < 0.3, "order {order:.2}: {coarse:.0} and {fine:.0} mm³");
}

#[test]
fn creases_and_thin_layers_come_out_whole() {
    for size_mm in [8.0, 5.0] {
        check(&Mound, &mesh(&Mound, size_mm));
    }
    check(&Torso::small(), &mesh(&Torso::small(), 8.0));
    check(&Torso::large(), &mesh(&Torso::large(), 10.0));
}

#[test]
fn another_placement_gives_the_same_body_with_other_nodes() {
    let placement = Placement { rotation: [0.3, -0.2, 0.5], offset: [0.5, 0.1, 0.7] };
    let meshing = Meshing { size_mm: 6.0, placement };
    let other = tetrahedralize(&Mound, &meshing, |_| Tissue::AdiposeLeft).unwrap();
    check(&Mound, &other);
    let usual = mesh(&Mound, 6.0);
    assert!((other.volume_mm3() / usual.volume_mm3() - 1.0).abs() < 5e-3);
    let shared = usual.points.iter().filter(|p| other.points.contains(p)).count();
    assert_eq!(shared, 0);
}

/// A torso whose skin and chest wall have bumps that are smaller than elements.
struct Bumpy(Torso);

impl Domain for Bumpy {
    fn distances(&self, p: &Vec3) -> PatchDistances {
        let bump = |k: f64| 1.5 * (k * p.x).sin() * (k * p.y).cos() * (k * p.z).sin();
        let smooth = self.0.distances(p);
        let of = |patch: Patch, k: f64| smooth.of(patch) + bump(k);
        smooth
            .with(Patch::Skin, of(Patch::Skin, 0.9))
            .with(Patch::ChestWall, of(Patch::ChestWall, 0.7))
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        self.0.bounds()
    }
}

#[test]
fn a_lattice_that_meets_bumps_badly_is_shifted() {
    let domain = Bumpy(Torso::small());
    let mut bad = 0;
    for n in 0..6 {
        let turn = 0.1 * f64::from(n);
        let placement = Placement { rotation: [turn, 0.3, 0.7 * turn], offset: [turn, 0.0, 0.4] };
        let meshing = Meshing { size_mm: 15.0, placement };
        bad += usize::from(on_lattice(&domain, &meshing, |_| Tissue::Skin).is_err());
        let mesh = tetrahedralize(&domain, &meshing, |_| Tissue::Skin).unwrap();
        assert!(mesh.tets.iter().all(|tet| TetMesh::tet_volume(&mesh.points, tet) > 0.0));
    }
    println!("{bad} of 6 lattices are bad");
    assert!(bad > 0, "no lattice had to be shifted");
}

#[test]
fn the_same_input_gives_the_same_mesh() {
    assert_eq!(mesh(&Mound, 7.0), mesh(&Mound, 7.0));
}

#[test]
fn nonsense_is_refused() {
    let ball = Ball { radius: 1.0 };
    let error = |domain: &dyn Domain, size_mm: f64| {
        tetrahedralize(domain, &Meshing::of_size(size_mm), |_| Tissue::Skin).err().unwrap()
    };
    for size_mm in [0.0, -1.0, f64::NAN, 1e-5] {
        assert!(matches!(error(&ball, size_mm), MeshError::BadInput(_)));
    }
    assert!(matches!(error(&Ball { radius: -1.0 }, 1.0), MeshError::BadInput(_)));
    assert!(matches!(error(&Everything, 1.0), MeshError::BadInput(_)));
    let far = Shifted(Vec3::repeat(1e3));
    assert_eq!(error(&far, 1.0), MeshError::Empty { size_mm: 1.0 });
}

/// All of space.
struct Everything;

impl Domain for Everything {
    fn distances(&self, _: &Vec3) -> PatchDistances {
        PatchDistances::none()
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        Ball { radius: 1.0 }.bounds()
    }
}

/// A ball that is not in its box.
struct Shifted(Vec3);

impl Domain for Shifted {
    fn distances(&self, p: &Vec3) -> PatchDistances {
        Ball { radius: 1.0 }.distances(&(p - self.0))
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        Ball { radius: 1.0 }.bounds()
    }
}
