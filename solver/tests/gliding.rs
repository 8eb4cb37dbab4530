//! A body that glides on the front of another one, which gives way: derivatives, balance, a block on a
//! block of other elements, and a stiff one as a rigid surface.

use crate::common::{
    contact::{balanced, state_of},
    shapes::brick,
};
use mammotwin_data::{
    Mat3, Vec3, mesh::Patch, mesh::TetMesh, progress::Silent, solution::Solution,
};
use mammotwin_solver::materials::Law;
use mammotwin_solver::terms::{
    Bulk, Front, Gliding, Gravity, Opening, Sliding, Term,
    target::{Plane, Sphere, Target},
    testing,
};
use mammotwin_solver::{Model, Options, SolveError, solve};
use std::sync::Arc;

/// Height (mm) of either block; the front of the lower one is the plane z = 0.
const HIGH_MM: f64 = 12.0;

/// Two blocks in one list of nodes.
struct Blocks {
    mesh: TetMesh,
    /// Nodes of the lower block, which come first, and its tetrahedra.
    nodes: usize,
    tets: usize,
    front: Vec<[u32; 3]>,
    rear: Vec<[u32; 3]>,
}

/// `lower` and `upper` squares along x and y on `width_mm` each, the upper block in the middle.
fn blocks(lower: usize, lower_mm: f64, upper: usize, upper_mm: f64) -> Blocks {
    let block = |cells: usize, width_mm: f64, below: f64| {
        let size = width_mm / cells as f64;
        brick([cells, cells, 2], |i, j, layer| {
            let along = |n: usize| size * n as f64 - 0.5 * width_mm;
            Vec3::new(along(i), along(j), 0.5 * HIGH_MM * layer as f64 - below)
        })
    };
    let (mut mesh, above) = (block(lower, lower_mm, HIGH_MM), block(upper, upper_mm, 0.0));
    let (nodes, tets) = (mesh.points.len(), mesh.tets.len());
    let shift = nodes as u32;
    let front = mesh.patch(Patch::Skin).to_vec();
    let rear = above.patch(Patch::ChestWall).iter().map(|f| f.map(|n| n + shift)).collect();
    mesh.points.extend(&above.points);
    mesh.tets.extend(above.tets.iter().map(|tet| tet.map(|n| n + shift)));
    mesh.tissues.extend(&above.tissues);
    Blocks { mesh, nodes, tets, front, rear }
}

impl Blocks {
    fn gliding(&self, target: Arc<dyn Target>) -> Gliding {
        let below = &self.mesh.tets[..self.tets];
        let front = Front::new(target, &self.mesh.points, &self.front, below).unwrap();
        Gliding::new("gliding", &self.rear, Arc::new(front), |_| true)
    }

    /// Both blocks on a fixed ground under gravity; `walls` keeps their sides from moving across.
    fn model(&self, young_kpa: [f64; 2], poisson: f64, gravity: Vec3, walls: bool) -> Model {
        let mut model = Model::new(&self.mesh);
        let law = |e: usize| {
            Law::neo_hookean_coupled(young_kpa[usize::from(e >= self.tets)], poisson).unwrap()
        };
        let laws = (0..self.mesh.tets.len()).map(law).collect();
        model.add(Bulk::new("blocks", &self.mesh, laws).unwrap()).unwrap();
        model.add(Gravity::new("gravity", &self.mesh, 0.981, gravity)).unwrap();
        let ends = |from: usize, to: usize, axis: usize| {
            self.mesh.points[from..to].iter().map(|p| p[axis].abs()).fold(0.0, f64::max)
        };
        for (from, to) in [(0, self.nodes), (self.nodes, self.mesh.points.len())] {
            for axis in 0..2 {
                let end = ends(from, to, axis);
                for n in from..to {
                    if walls && self.mesh.points[n][axis].abs() > end - 1e-9 {
                        model.fix(n as u32, axis);
                    }
                }
            }
        }
        for n in 0..self.nodes {
            if self.mesh.points[n].z < -HIGH_MM + 1e-9 {
                model.fix_node(n as u32);
            }
        }
        model
    }

    fn on_plane(&self) -> Gliding {
        self.gliding(Arc::new(PLANE))
    }
}

const PLANE: Plane = Plane { point: Vec3::new(0.0, 0.0, 0.0), normal: Vec3::new(0.0, 0.0, 1.0) };

/// Smooth and large: neither a rigid motion nor an affine one.
fn bent(p: &Vec3) -> Vec3 {
    let (x, y, z) = (0.05 * p.x, 0.04 * p.y, 0.1 * p.z);
    p + Vec3::new(
        1.5 * (y + z).sin() + x * y,
        2.0 * x.sin() - 0.5 * z,
        1.7 * (x - y).sin() + 0.3 * z * x,
    )
}

/// Verifies: force and tangent of the contact with a deformed front | fourth-order differences | 1e-7, 1e-6
#[test]
fn force_and_tangent_are_derivatives_of_the_energy() {
    // Before the lower block alone, and beyond its rim, too.
    for (lower_mm, beyond) in [(40.0, 0), (20.0, 12)] {
        let blocks = blocks(2, lower_mm, 3, 30.0);
        let sphere = Sphere { center: Vec3::new(3.0, -2.0, -50.0), radius_mm: 50.0 };
        let term = blocks.gliding(Arc::new(sphere));
        let alone = (0..term.elements()).filter(|&n| term.nodes(n).len() == 1).count();
        assert_eq!(alone, beyond);
        assert_eq!(term.is_internal(), beyond == 0);
        let points: Vec<Vec3> = blocks.mesh.points.iter().map(bent).collect();
        let memory: Vec<f64> = (0..term.elements()).map(|n| 0.7 * (1.3 * n as f64).sin()).collect();
        let shear = vec![0.2; points.len()];
        testing::check(&term, &state_of(&points, &memory, &shear));
        if beyond == 0 {
            // Nodes that have gone to and fro are borne by two or three tetrahedra.
            let shared = to_and_fro(&blocks, term, &points);
            let bearing = |n: usize| shared.nodes(n).len();
            let several = (0..shared.elements()).filter(|&n| bearing(n) > 5).count();
            assert!(several >= 6 && (0..shared.elements()).any(|n| bearing(n) > 7), "{several}");
            testing::check(&*shared, &state_of(&points, &memory, &shear));
        }
    }
}

/// The contact after the upper block has been moved round and round.
fn to_and_fro(blocks: &Blocks, term: Gliding, points: &[Vec3]) -> Arc<dyn Term> {
    let mut term: Arc<dyn Term> = Arc::new(term);
    for turn in 0..12 {
        let angle = 2.1 * f64::from(turn);
        let mut moved = points.to_vec();
        let way = 6.0 * Vec3::new(angle.cos(), angle.sin(), 0.0);
        moved[blocks.nodes..].iter_mut().for_each(|p| *p += way);
        term = term.moved_on(&moved).unwrap_or(term);
    }
    term
}

/// Verifies: forces of the contact with a deformed front on both bodies | force and moment balance, rigid motion | 1e-10, 1e-9
#[test]
fn both_bodies_bear_opposite_forces_and_rigid_motions_change_nothing() {
    let blocks = blocks(2, 40.0, 3, 30.0);
    let sphere = Sphere { center: Vec3::new(3.0, -2.0, -50.0), radius_mm: 50.0 };
    let term = blocks.gliding(Arc::new(sphere));
    let points: Vec<Vec3> = blocks.mesh.points.iter().map(bent).collect();
    let (memory, shear) = (vec![-0.4; term.elements()], vec![0.2; points.len()]);
    let pressed = balanced(&term, &points, &memory, &shear, 40.0);
    assert_eq!(pressed, term.elements());
    let shared = to_and_fro(&blocks, term, &points);
    assert_eq!(balanced(&*shared, &points, &memory, &shear, 40.0), shared.elements());
}

fn solved(model: &Model, start: &[Vec3]) -> Result<Solution, SolveError> {
    let found = solve(model, start, &Options::default(), &Silent)?;
    println!("{:?}", found.checks);
    assert!(found.checks.force_imbalance < 2e-6 && found.checks.moment_imbalance < 2e-6);
    assert!(found.checks.max_gap_mm < 0.05 && found.checks.max_penetration_mm < 0.05);
    Ok(found)
}

/// Mean of a stress component over some tetrahedra, by volume, and its largest departure from that.
fn mean(
    blocks: &Blocks,
    found: &Solution,
    of: impl Fn(&Mat3) -> f64,
    wanted: impl Fn(&Vec3) -> bool,
) -> (f64, f64) {
    let points = &blocks.mesh.points;
    let chosen: Vec<(f64, f64)> = blocks
        .mesh
        .tets
        .iter()
        .zip(&found.cauchy_kpa)
        .filter(|(tet, _)| wanted(&(tet.iter().map(|&n| points[n as usize]).sum::<Vec3>() / 4.0)))
        .map(|(tet, stress)| (TetMesh::tet_volume(points, tet), of(stress)))
        .collect();
    let volume: f64 = chosen.iter().map(|(v, _)| v).sum();
    let mean = chosen.iter().map(|(v, s)| v * s).sum::<f64>() / volume;
    (mean, chosen.iter().map(|(_, s)| (s - mean).abs()).fold(0.0, f64::max))
}

/// Verifies: a block that lies on another one, between walls, under its weight; elements that match, and that do not | p = ρ g h in the mean, no shear; scatter with matching elements | mean 2 %, shear 3 %, scatter 12 %
#[test]
fn pressure_goes_through_the_front() {
    for (lower, upper) in [(4, 4), (3, 6), (4, 3)] {
        let blocks = blocks(lower, 40.0, upper, 40.0);
        let mut model = blocks.model([20.0, 20.0], 0.3, Vec3::new(0.0, 0.0, -10.0), true);
        model.add(blocks.on_plane()).unwrap();
        let found = solved(&model, &blocks.mesh.points).unwrap();
        let weight_kpa = 10.0 * 0.981 * 9.80665e-3 * HIGH_MM;
        let below = |z: f64| move |p: &Vec3| p.z < z && p.z > z - 0.5 * HIGH_MM;
        let (normal, scatter) = mean(&blocks, &found, |s| s[(2, 2)], below(0.0));
        let (above, _) = mean(&blocks, &found, |s| s[(2, 2)], below(0.5 * HIGH_MM));
        let (shear, _) = mean(&blocks, &found, |s| s[(0, 2)], below(0.0));
        println!(
            "{lower} squares under {upper}: normal stress {normal:.5} ± {scatter:.5} kPa below, {above:.5} above, \
             weight {weight_kpa:.5} kPa, shear {shear:.6}"
        );
        // In the middle of either layer: the block above and a quarter of the one below, or three quarters.
        assert!((normal / (-1.25 * weight_kpa) - 1.0).abs() < 0.02, "{normal}");
        assert!((above / (-0.75 * weight_kpa) - 1.0).abs() < 0.02, "{above}");
        assert!(shear.abs() < 0.03 * weight_kpa, "{shear}");
        assert!(lower != upper || scatter < 0.12 * weight_kpa, "{scatter}");
    }
}

/// Verifies: a soft block that glides on one of 1e5 kPa | the same block on a rigid plane | 0.02 mm
#[test]
fn a_stiff_body_is_a_rigid_surface() {
    let blocks = blocks(4, 40.0, 3, 30.0);
    let gravity = Vec3::new(0.0, 0.0, -3.0);
    let mut model = blocks.model([1e5, 2.0], 0.49, gravity, false);
    model.add(blocks.on_plane()).unwrap();
    let mut rigid = blocks.model([1e5, 2.0], 0.49, gravity, false);
    let sliding = Sliding::new("plane", &blocks.mesh.points, &blocks.rear, Arc::new(PLANE));
    rigid.add(sliding.opening(Opening::Never)).unwrap();
    for model in [&mut model, &mut rigid] {
        // Nothing else holds the upper block from gliding off.
        for (n, p) in blocks.mesh.points.iter().enumerate().skip(blocks.nodes) {
            for axis in
                (0..2).filter(|&axis| p[axis].abs() < 6.0 && p.x.abs() < 6.0 && p.y.abs() < 6.0)
            {
                model.fix(n as u32, axis);
            }
        }
    }
    let (on_body, on_plane) = (
        solved(&model, &blocks.mesh.points).unwrap(),
        solved(&rigid, &blocks.mesh.points).unwrap(),
    );
    let apart = on_body.points.iter().zip(&on_plane.points).map(|(a, b)| (a - b).norm());
    let most = apart.fold(0.0, f64::max);
    let moved = on_plane.points.iter().zip(&blocks.mesh.points).map(|(a, b)| (a - b).norm());
    println!("{most:.2e} mm apart, moved by {:.3} mm", moved.fold(0.0, f64::max));
    // Gaps are below 0.01 mm.
    assert!(most < 0.02);
}

/// Verifies: a block drawn 15 mm over a soft one, across its elements | the same block put there at once | 0.1 mm
#[test]
fn nodes_go_on_to_the_elements_that_they_come_to() {
    let blocks = blocks(6, 60.0, 3, 20.0);
    let gravity = Vec3::new(0.0, 0.0, -3.0);
    let way = Vec3::new(13.0, 7.0, 0.0);
    let side = |p: &Vec3| p.x.abs() > 10.0 - 1e-9;
    let model = |blocks: &Blocks, term: Gliding, way: Vec3| {
        let mut model = blocks.model([3.0, 20.0], 0.45, gravity, false);
        model.add(term).unwrap();
        // Its upper edges are drawn along, and sink as they like.
        for n in blocks.nodes..blocks.mesh.points.len() {
            let p = blocks.mesh.points[n];
            if side(&p) && p.z > HIGH_MM - 1e-9 {
                model.fix(n as u32, 0);
                model.fix(n as u32, 1);
            }
        }
        let start: Vec<Vec3> =
            blocks
                .mesh
                .points
                .iter()
                .enumerate()
                .map(|(n, p)| {
                    if n >= blocks.nodes && side(p) && p.z > HIGH_MM - 1e-9 { p + way } else { *p }
                })
                .collect();
        (model, start)
    };
    let (drawn, mut start) = model(&blocks, blocks.on_plane(), way);
    // All of the block goes along, so that no element is torn; the contact knows its first elements only.
    start.iter_mut().enumerate().for_each(|(n, p)| {
        if n >= blocks.nodes {
            *p = blocks.mesh.points[n] + way;
        }
    });
    let drawn = solved(&drawn, &start).unwrap();
    let mut there = super_blocks(&blocks, way);
    there.rear.clone_from(&blocks.rear);
    let (put, start) = model(&there, there.on_plane(), Vec3::zeros());
    let put = solved(&put, &start).unwrap();
    let apart = drawn.points.iter().zip(&put.points).map(|(a, b)| (a - b).norm());
    let most = apart.fold(0.0, f64::max);
    let dent =
        put.points[..blocks.nodes].iter().zip(&blocks.mesh.points).map(|(a, b)| (a - b).norm());
    println!("{most:.4} mm apart; the lower block gave way by {:.3} mm", dent.fold(0.0, f64::max));
    assert!(most < 0.1);
    // Nothing draws the lower block along.
    let along = |n: usize| (drawn.points[n] - blocks.mesh.points[n]).dot(&way.normalize());
    let drift = (0..blocks.nodes).map(along).sum::<f64>() / blocks.nodes as f64;
    println!("it is drawn along by {drift:.5} mm");
    assert!(drift.abs() < 0.01);
}

/// Verifies: a block drawn over the rim of a soft and of a stiff one | put there at once; the smooth surface at rest | 0.1 mm; 0.02 mm
#[test]
fn beyond_the_rim_the_smooth_surface_carries() {
    let blocks = blocks(6, 40.0, 3, 20.0);
    let way = Vec3::new(17.0, 7.0, 0.0);
    let there = super_blocks(&blocks, way);
    let gravity = Vec3::new(0.0, 0.0, -3.0);
    let from = |young_kpa: f64, blocks: &Blocks, term: Box<dyn FnOnce(&mut Model)>| {
        let mut model = blocks.model([young_kpa, 20.0], 0.45, gravity, false);
        term(&mut model);
        for (n, p) in blocks.mesh.points.iter().enumerate() {
            // The lower block is held at its rim, the upper one at its upper edges where it comes to be.
            if n < blocks.nodes && p.x.abs().max(p.y.abs()) > 20.0 - 1e-9 {
                model.fix_node(n as u32);
            } else if n >= blocks.nodes && p.z > HIGH_MM - 1e-9 {
                model.fix(n as u32, 0);
                model.fix(n as u32, 1);
            }
        }
        solved(&model, &there.mesh.points).unwrap()
    };
    let apart = |one: &Solution, other: &Solution| {
        let far = one.points.iter().zip(&other.points).map(|(a, b)| (a - b).norm());
        far.fold(0.0, f64::max)
    };
    let drawn = |young_kpa| {
        let term = blocks.on_plane();
        from(young_kpa, &there, Box::new(move |model| model.add(term).unwrap()))
    };
    let mut put = super_blocks(&blocks, way);
    put.rear.clone_from(&blocks.rear);
    let term = put.on_plane();
    let beyond = (0..term.elements()).filter(|&n| term.nodes(n).len() == 1).count();
    assert!((4..=12).contains(&beyond), "{beyond}");
    let put = from(3.0, &there, Box::new(move |model| model.add(term).unwrap()));
    let (rear, points) = (blocks.rear.clone(), there.mesh.points.clone());
    let rigid = Sliding::new("sliding", &points, &rear, Arc::new(PLANE));
    let rigid = from(3.0, &there, Box::new(move |model| model.add(rigid).unwrap()));
    let upper =
        |found: Solution| Solution { points: found.points[blocks.nodes..].to_vec(), ..found };
    let (soft, stiff) = (apart(&drawn(3.0), &put), apart(&upper(drawn(2e4)), &upper(rigid)));
    println!("soft {soft:.4} mm, stiff {stiff:.4} mm apart");
    assert!(soft < 0.1 && stiff < 0.02, "{soft} {stiff}");
}

/// The same blocks, the upper one elsewhere.
fn super_blocks(blocks: &Blocks, way: Vec3) -> Blocks {
    let mut mesh = blocks.mesh.clone();
    mesh.points[blocks.nodes..].iter_mut().for_each(|p| *p += way);
    Blocks {
        mesh,
        nodes: blocks.nodes,
        tets: blocks.tets,
        front: blocks.front.clone(),
        rear: Vec::new(),
    }
}

#[test]
fn a_front_of_other_tetrahedra_is_refused() {
    let blocks = blocks(2, 40.0, 2, 40.0);
    let above = &blocks.mesh.tets[blocks.tets..];
    let front = Front::new(Arc::new(PLANE), &blocks.mesh.points, &blocks.front, above);
    let text = front.err().unwrap().to_string();
    assert!(text.contains("without a tetrahedron"), "{text}");
}
