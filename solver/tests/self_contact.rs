//! Skin that touches skin: derivatives, balance, what is told from what lies behind its own tissue, and two
//! beams that meet where each would meet a mirror.

use crate::common::{
    contact::{balanced, state_of},
    shapes::brick,
};
use mammotwin_data::{Vec3, mesh::Patch, mesh::TetMesh, progress::Silent};
use mammotwin_solver::materials::Law;
use mammotwin_solver::terms::{
    Bulk, Gravity, Opening, SelfContact, Sliding, Term, target::Plane, testing,
};
use mammotwin_solver::{Model, Options, solve};
use std::sync::Arc;

/// Length, width and height (mm) of a beam, and half of the way between the two.
const LONG_MM: f64 = 60.0;
const WIDE_MM: f64 = 15.0;
const HIGH_MM: f64 = 10.0;
const HALF_MM: f64 = 2.0;

/// A beam above the plane z = 0, and another one below it whose squares are not those of the first.
struct Beams {
    mesh: TetMesh,
    /// Tetrahedra of the upper one, which come first.
    upper: usize,
    /// The sides that look at each other.
    skin: Vec<[u32; 3]>,
}

fn beam([along, across]: [usize; 2], side: f64) -> TetMesh {
    brick([along, across, 2], |i, j, layer| {
        let height = HALF_MM + 0.5 * HIGH_MM * layer as f64;
        // The lower beam is turned about the x axis, so that its tetrahedra stay right-handed.
        let y = WIDE_MM * (j as f64 / across as f64 - 0.5);
        Vec3::new(LONG_MM * i as f64 / along as f64, side * y, side * height)
    })
}

fn beams(upper: [usize; 2], lower: [usize; 2]) -> Beams {
    let (mut mesh, below) = (beam(upper, 1.0), beam(lower, -1.0));
    let (shift, tets) = (mesh.points.len() as u32, mesh.tets.len());
    let mut skin = mesh.patch(Patch::ChestWall).to_vec();
    skin.extend(below.patch(Patch::ChestWall).iter().map(|face| face.map(|n| n + shift)));
    mesh.points.extend(&below.points);
    mesh.tets.extend(below.tets.iter().map(|tet| tet.map(|n| n + shift)));
    mesh.tissues.extend(&below.tissues);
    Beams { mesh, upper: tets, skin }
}

/// Held at one end, drawn towards the other beam by `pull` times the weight of tissue.
fn model(mesh: &TetMesh, upper: usize, pull: f64) -> Model {
    let mut model = Model::new(mesh);
    let law = Law::neo_hookean_coupled(20.0, 0.45).unwrap();
    model.add(Bulk::new("beams", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    for (name, tets, down) in [("down", 0..upper, -pull), ("up", upper..mesh.tets.len(), pull)] {
        if !tets.is_empty() {
            let tissues = mesh.tissues[tets.clone()].to_vec();
            let part = TetMesh { tets: mesh.tets[tets].to_vec(), tissues, ..mesh.clone() };
            let way = Vec3::new(0.0, 0.0, down);
            model.add(Gravity::new(name, &part, 0.981, way)).unwrap();
        }
    }
    for (n, p) in mesh.points.iter().enumerate() {
        if p.x < 1e-9 {
            model.fix_node(n as u32);
        }
    }
    model
}

/// Both beams bent through each other by `deep_mm` and more.
fn through(beams: &Beams, deep_mm: f64) -> Vec<Vec3> {
    let one = |p: &Vec3| {
        let side = p.z.signum();
        let sinks = (HALF_MM + 0.5 * deep_mm) * p.x / LONG_MM;
        p + Vec3::new(0.3 * (0.1 * p.y).sin(), 0.2 * (0.07 * p.x).sin(), -side * sinks)
    };
    beams.mesh.points.iter().map(one).collect()
}

/// The contact as it is where the nodes are at `points`.
fn found(beams: &Beams, points: &[Vec3]) -> Arc<dyn Term> {
    let term = SelfContact::new("skin_contact", &beams.mesh, &beams.skin);
    term.moved_on(points).expect("skins that meet")
}

/// Verifies: force and tangent of skin on skin | fourth-order differences | 1e-7, 1e-6
#[test]
fn force_and_tangent_are_derivatives_of_the_energy() {
    let beams = beams([6, 2], [5, 2]);
    let points = through(&beams, 1.0);
    let term = found(&beams, &points);
    // All of them press, even where they are some millimetres apart.
    let memory: Vec<f64> = (0..term.elements()).map(|n| -400.0 - (1.3 * n as f64).sin()).collect();
    let shear = vec![0.2; points.len()];
    testing::check(term.as_ref(), &state_of(&points, &memory, &shear));
}

/// Verifies: forces of skin on skin | force and moment balance, rigid motion | 1e-10, 1e-9
#[test]
fn both_skins_bear_opposite_forces_and_rigid_motions_change_nothing() {
    let beams = beams([6, 2], [5, 2]);
    let points = through(&beams, 1.0);
    let term = found(&beams, &points);
    let (memory, shear) = (vec![-0.4; term.elements()], vec![0.2; points.len()]);
    let pressed = balanced(term.as_ref(), &points, &memory, &shear, LONG_MM);
    println!("{pressed} of {} nodes press", term.elements());
    assert!(pressed > 8);
}

/// Verifies: two beams that bend towards each other, of elements that match and that do not | one beam on a rigid plane between them | 0.05 and 0.15 mm
#[test]
fn beams_meet_where_a_mirror_would_be() {
    let pull = 0.3;
    let alone = beam([12, 3], 1.0);
    let mut mirror = model(&alone, alone.tets.len(), pull);
    let plane = Plane { point: Vec3::zeros(), normal: Vec3::z() };
    let faces = alone.patch(Patch::ChestWall);
    let sliding = Sliding::new("plane", &alone.points, faces, Arc::new(plane));
    mirror.add(sliding.opening(Opening::Free)).unwrap();
    let on_plane = solve(&mirror, &alone.points, &Options::default(), &Silent).unwrap();
    let wanted_mn = on_plane.forces["plane"].z;
    let sunk = on_plane.points.iter().zip(&alone.points).map(|(a, b)| (a.z - b.z).abs());
    println!("sinks by {:.2} mm, {wanted_mn:.1} mN", sunk.fold(0.0, f64::max));

    for lower in [[12, 3], [9, 2]] {
        let beams = beams([12, 3], lower);
        let mut model = model(&beams.mesh, beams.upper, pull);
        let free = solve(&model, &beams.mesh.points, &Options::default(), &Silent).unwrap();
        model.add(SelfContact::new("skin_contact", &beams.mesh, &beams.skin)).unwrap();
        let met = solve(&model, &beams.mesh.points, &Options::default(), &Silent).unwrap();
        println!("{:?}", met.checks);
        let count = alone.points.len();
        let off = met.points[..count].iter().zip(&on_plane.points).map(|(a, b)| (a - b).norm());
        let off = off.fold(0.0, f64::max);
        let crossed = free.points[..count].iter().map(|p| -p.z).fold(0.0, f64::max);
        println!(
            "{lower:?}: {off:.3} mm from the one on the plane; without contact {crossed:.1} mm beyond it"
        );
        // Without it they pass through each other.
        assert!(crossed > 5.0, "{crossed}");
        assert!(off < if lower == [12, 3] { 0.05 } else { 0.15 }, "{off}");
        assert!(met.checks.max_penetration_mm < 0.05 && met.checks.residual < 1e-6);
        assert!(met.checks.force_imbalance < 2e-6 && met.checks.moment_imbalance < 2e-6);
        assert!(met.forces["skin_contact"].norm() < 1e-6 * wanted_mn);
    }
}

/// What lies behind a face of its own thin tissue has not come through it, what has sunk into other tissue has.
#[test]
fn thin_tissue_is_no_contact() {
    let flat = brick([6, 6, 1], |i, j, layer| {
        Vec3::new(5.0 * i as f64, 5.0 * j as f64, 3.0 * layer as f64)
    });
    let skin: Vec<[u32; 3]> =
        [Patch::Skin, Patch::ChestWall].iter().flat_map(|p| flat.patch(*p)).copied().collect();
    let term = SelfContact::new("skin_contact", &flat, &skin);
    assert!(term.moved_on(&flat.points).is_none());

    let beams = beams([6, 2], [5, 2]);
    let term = SelfContact::new("skin_contact", &beams.mesh, &beams.skin);
    // Four millimetres apart is no contact yet, but watched; farther is nothing.
    let apart: Vec<Vec3> =
        beams.mesh.points.iter().map(|p| p + Vec3::z() * p.z.signum() * 0.5).collect();
    assert!(term.moved_on(&apart).is_none());
    for deep_mm in [0.5, 4.0, 12.0] {
        let points = through(&beams, deep_mm);
        let moved = term.moved_on(&points).unwrap();
        let deep = moved.contact(&state_of(
            &points,
            &vec![0.0; moved.elements()],
            &vec![1.0; points.len()],
        ));
        let deep = deep.unwrap().penetration_mm;
        println!("{deep_mm} mm at the ends: {deep:.2} mm seen");
        assert!((deep / deep_mm - 1.0).abs() < 0.25, "{deep}");
    }
}
