//! Derivatives of equilibria by the numbers of their models, against equilibria nearby.
//!
//! A Taylor test: what is left of u(θ + h d) - u(θ) - h u'd falls as h², for a random direction d in
//! all numbers of a model at once. Direct and adjoint derivatives are the same number.

use crate::common;

use common::{coarse, shapes::brick};
use mammotwin_data::{
    Vec3,
    mesh::{Patch, TetMesh},
    solution::Solution,
    study::LawName,
};
use mammotwin_solver::materials::Law;
use mammotwin_solver::newton::NewtonOptions;
use mammotwin_solver::paddles::{Outline, RoundedPlate};
use mammotwin_solver::sensitivity::{Change, Linearised, Observable, SensitivityError};
use mammotwin_solver::terms::{
    Bulk, Cable, Cables, Gravity, Load, Membrane, Sliding, Slip,
    plate::{Plate, PlateKind},
    target::Cylinder,
};
use mammotwin_solver::{Model, Options};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// Part of a number over which the sums are differenced.
const NEARBY: f64 = 1e-5;

/// Models of some numbers, and how they are loaded.
struct Family<'a> {
    mesh: &'a TetMesh,
    build: &'a dyn Fn(&[f64]) -> (Model, Load),
    numbers: &'a [f64],
    observables: Vec<Observable>,
}

fn options() -> Options {
    Options {
        newton: NewtonOptions { residual: 1e-12, ..NewtonOptions::default() },
        contact_mm: 1e-9,
        ..Options::default()
    }
}

/// Where the path begins: nothing pulls, and plates are far.
const START: Load = Load { gravity: 0.0, receptor_mm: -80.0, thickness_mm: 160.0, ..Load::GRAVITY };

impl Family<'_> {
    fn solved<R>(&self, numbers: &[f64], then: impl FnOnce(Solution, Linearised) -> R) -> R {
        let (model, load) = (self.build)(numbers);
        let (solution, linearised) =
            Linearised::follow(&model, &self.mesh.points, START, &[load], &options()).unwrap();
        then(solution, linearised)
    }

    fn value(&self, observable: &Observable, solution: &Solution) -> f64 {
        match observable {
            Observable::Position(weights) => {
                solution.points.iter().zip(weights).map(|(p, w)| p.dot(w)).sum()
            }
            Observable::Force { term, along } => solution.forces[term].dot(along),
            Observable::Support(along) => solution.forces["fixed"].dot(along),
            Observable::Volume(tets) => {
                tets.iter().map(|tet| TetMesh::tet_volume(&solution.points, tet)).sum()
            }
        }
    }

    /// Taylor test of the positions and of each observable along a random direction.
    #[track_caller]
    fn check(&self, seed: u64, largest: f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let scale = |n: &f64| if *n == 0.0 { 1.0 } else { n.abs() };
        let direction: Vec<f64> =
            self.numbers.iter().map(|n| scale(n) * rng.random_range(-1.0..1.0)).collect();
        let (here, moved, slopes) = self.solved(self.numbers, |solution, mut at| {
            let changes: Vec<Change> = (0..self.numbers.len())
                .map(|n| {
                    let step = NEARBY * scale(&self.numbers[n]);
                    let beside = [-step, step].map(|by| {
                        let mut numbers = self.numbers.to_vec();
                        numbers[n] += by;
                        (self.build)(&numbers)
                    });
                    at.change([0, 1].map(|k| (&beside[k].0, beside[k].1)), step).unwrap()
                })
                .collect();
            let responses: Vec<_> = changes.iter().map(|c| at.response(c).unwrap()).collect();
            let mut moved = vec![Vec3::zeros(); solution.points.len()];
            for (response, along) in responses.iter().zip(&direction) {
                moved.iter_mut().zip(&response.moved).for_each(|(m, u)| *m += *along * u);
            }
            let mut slopes = Vec::new();
            for observable in &self.observables {
                let adjoint = at.adjoint(observable).unwrap();
                let each: Vec<[f64; 2]> = changes
                    .iter()
                    .zip(&responses)
                    .map(|(change, response)| {
                        let direct = at.derivative(observable, change, response).unwrap();
                        [direct, at.adjoint_derivative(&adjoint, change)]
                    })
                    .collect();
                let largest = each.iter().zip(&direction).map(|(e, d)| (e[0] * d).abs());
                let largest = largest.fold(f64::MIN_POSITIVE, f64::max);
                for ([direct, adjoint], along) in each.iter().zip(&direction) {
                    let apart = ((direct - adjoint) * along).abs() / largest;
                    assert!(apart < 1e-10, "{direct} direct, {adjoint} adjoint: {apart:.1e}");
                }
                slopes.push(each.iter().zip(&direction).map(|(e, d)| e[0] * d).sum::<f64>());
            }
            (solution, moved, slopes)
        });
        let mut left: Vec<Vec<f64>> = Vec::new();
        for h in [largest, 0.5 * largest, 0.25 * largest] {
            let numbers: Vec<f64> =
                self.numbers.iter().zip(&direction).map(|(n, d)| n + h * d).collect();
            let there = self.solved(&numbers, |solution, _| solution);
            let rest = here.points.iter().zip(&there.points).zip(&moved);
            let rest: f64 = rest.map(|((a, b), u)| (b - a - h * u).norm_squared()).sum();
            let far = here.points.iter().zip(&there.points).map(|(a, b)| (b - a).norm_squared());
            let mut errors = vec![rest.sqrt()];
            for (observable, slope) in self.observables.iter().zip(&slopes) {
                let [a, b] = [&here, &there].map(|s| self.value(observable, s));
                errors.push((b - a - h * slope).abs());
            }
            println!("h {h:.1e}: moved {:.3e} mm, left {errors:?}", far.sum::<f64>().sqrt());
            left.push(errors);
        }
        let rate = |n: usize, k: usize| (left[k][n] / left[k + 1][n]).log2();
        let rates: Vec<[f64; 2]> = (0..=slopes.len()).map(|n| [rate(n, 0), rate(n, 1)]).collect();
        println!("slopes {slopes:.4?}, rates {rates:.3?}");
        assert!(rates.iter().all(|rate| rate[1] >= 1.9), "{rates:?}");
    }
}

fn vertical(mesh: &TetMesh, node: usize) -> Observable {
    let mut weights = vec![Vec3::zeros(); mesh.points.len()];
    weights[node] = Vec3::new(0.3, -0.2, 1.0);
    Observable::Position(weights)
}

fn force(term: &str, along: Vec3) -> Observable {
    Observable::Force { term: term.into(), along }
}

/// Verifies: derivatives: Gent block, skin, cable, gravity | Taylor test; adjoint | rate 1.9; 1e-10
#[test]
fn a_block_under_skin_and_cables_follows_all_its_numbers() {
    let mesh = brick([5, 5, 4], |i, j, l| 8.0 * Vec3::new(i as f64, j as f64, l as f64));
    let top = mesh.points.len() - 1;
    let build = |p: &[f64]| {
        let mut model = Model::new(&mesh);
        let law = Law::new(LawName::Gent, p[0], p[1], Some(p[2])).unwrap();
        model.add(Bulk::new("block", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
        let gravity = Vec3::new(p[4], p[5], p[6]);
        model.add(Gravity::new("gravity", &mesh, p[3], gravity)).unwrap();
        let skin = Law::new(LawName::NeoHookean, p[7], 0.49, None).unwrap();
        let faces = mesh.patch(Patch::Skin);
        model.add(Membrane::uniform("skin", &mesh.points, faces, p[8], skin).unwrap()).unwrap();
        let cable = Cable {
            node: top as u32,
            anchor: mesh.points[top] + Vec3::new(-8.0, 3.0, -40.0),
            natural_mm: 40.0,
            stiffness_mn_per_mm: p[9],
        };
        model.add(Cables::new("cable", vec![cable]).unwrap()).unwrap();
        for node in mesh.patch_nodes(Patch::ChestWall) {
            model.fix_node(node);
        }
        (model, Load { gravity: 1.0, ..START })
    };
    // Moduli, Poisson's ratio, Jₘ, density, gravity, skin with its thickness, cable.
    let numbers = [0.6, 0.485, 3.0, 0.981, 0.3, 0.1, 0.9, 8.0, 1.5, 0.3];
    let family = Family {
        mesh: &mesh,
        build: &build,
        numbers: &numbers,
        observables: vec![
            vertical(&mesh, top),
            Observable::Support(Vec3::new(0.2, 0.1, 1.0)),
            force("cable", Vec3::new(0.5, 0.0, 1.0)),
            Observable::Volume(mesh.tets.clone()),
        ],
    };
    for seed in [1, 2] {
        family.check(seed, 0.01);
    }
}

/// Verifies: derivatives: breast that slides | Taylor test; adjoint | rate 1.9; 1e-10
#[test]
fn a_breast_that_slides_on_the_chest_wall_follows_its_tissues() {
    let body = coarse();
    let mesh = &body.mesh;
    let build = |p: &[f64]| {
        let mut model = Model::new(mesh);
        let law = Law::new(LawName::NeoHookean, p[0], p[1], None).unwrap();
        model.add(Bulk::new("breast", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
        let gravity = Vec3::new(p[2], p[3], p[4]);
        model.add(Gravity::new("gravity", mesh, 0.981, gravity)).unwrap();
        let skin = Law::new(LawName::NeoHookean, p[5], 0.49, None).unwrap();
        let faces = mesh.patch(Patch::Skin);
        model.add(Membrane::uniform("skin", &mesh.points, faces, 1.5, skin).unwrap()).unwrap();
        let wall = Cylinder { point: Vec3::z() * -150.0, axis: Vec3::y(), radius_mm: 150.0 + p[6] };
        let faces = mesh.patch(Patch::ChestWall);
        let wall = Sliding::new("wall", &mesh.points, faces, Arc::new(wall));
        let held: Vec<u32> = body.rim.clone();
        model.add(wall.without(|node| held.contains(&node))).unwrap();
        for &node in &body.rim {
            model.fix_node(node);
        }
        (model, Load { gravity: 1.0, ..START })
    };
    // Modulus, Poisson's ratio, gravity, skin, and how far (mm) the wall stands out.
    let numbers = [0.5, 0.49, 0.2, -0.4, 0.9, 4.0, 0.0];
    let family = Family {
        mesh,
        build: &build,
        numbers: &numbers,
        observables: vec![
            vertical(mesh, body.nipple),
            force("wall", Vec3::z()),
            Observable::Support(Vec3::new(1.0, 0.0, 0.5)),
            Observable::Volume(mesh.tets.clone()),
        ],
    };
    family.check(3, 1e-3);
}

fn plates(mesh: &TetMesh, model: &mut Model, slip: Slip) {
    for (kind, into) in [(PlateKind::Receptor, -Vec3::y()), (PlateKind::Paddle, Vec3::y())] {
        let shape = RoundedPlate {
            into,
            away: Vec3::z(),
            edge_mm: 20.0,
            radius_mm: 10.0,
            middle_mm: 0.0,
            outline: Outline::ENDLESS,
        };
        let plate = Plate::new(kind, shape, &mesh.points, mesh.patch(Patch::Skin));
        let held = mesh.patch_nodes(Patch::ChestWall);
        model.add(plate.without(|n| held.contains(&n)).slip(slip).unwrap()).unwrap();
    }
}

fn squeezed(mesh: &TetMesh, p: &[f64], slip: Slip) -> (Model, Load) {
    let mut model = Model::new(mesh);
    let law = Law::new(LawName::Gent, p[0], p[1], Some(p[2])).unwrap();
    model.add(Bulk::new("breast", mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    for node in mesh.patch_nodes(Patch::ChestWall) {
        model.fix_node(node);
    }
    plates(mesh, &mut model, slip);
    (model, Load { gravity: 0.0, receptor_mm: -0.5 * p[3], thickness_mm: p[3], ..START })
}

/// Verifies: derivatives: forces of the plates | Taylor test; adjoint | rate 1.9; 1e-10
#[test]
fn the_force_of_the_plates_follows_tissue_and_thickness() {
    let body = coarse();
    let mesh = &body.mesh;
    let build = |p: &[f64]| squeezed(mesh, p, Slip::Free);
    let family = Family {
        mesh,
        build: &build,
        // Modulus, Poisson's ratio, Jₘ, thickness (mm).
        numbers: &[0.5, 0.49, 2.0, 100.0],
        observables: vec![
            force("paddle", -Vec3::y()),
            force("receptor", Vec3::y()),
            vertical(mesh, body.nipple),
            Observable::Volume(mesh.tets.clone()),
        ],
    };
    family.check(5, 4e-3);
}

#[test]
fn what_has_no_derivative_is_refused() {
    let body = coarse();
    let (model, load) = squeezed(&body.mesh, &[0.5, 0.49, 2.0, 120.0], Slip::Coulomb(0.2));
    let refused = Linearised::follow(&model, &body.mesh.points, START, &[load], &options());
    assert!(matches!(refused.err().unwrap(), SensitivityError::Lags(term) if term == "receptor"));
    let (model, load) = squeezed(&body.mesh, &[0.5, 0.49, 2.0, 120.0], Slip::Free);
    let (_, mut at) =
        Linearised::follow(&model, &body.mesh.points, START, &[load], &options()).unwrap();
    let other = Model::new(&body.mesh);
    let other = at.change_of_model([&other, &other], 1.0);
    assert!(matches!(other.unwrap_err(), SensitivityError::Other(_)));
    let nothing = at.adjoint(&force("nothing", Vec3::x()));
    assert!(matches!(nothing.err().unwrap(), SensitivityError::NoTerm(_)));
}
