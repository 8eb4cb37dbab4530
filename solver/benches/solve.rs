//! Time of equilibria from rest: a breast of 20 thousand tetrahedra under gravity, and one of 5
//! thousand squeezed from 132 to 50 mm; a curve of 20 points.

#![allow(missing_docs, clippy::unwrap_used)] // a benchmark may fail at once

#[path = "../tests/common/mod.rs"]
mod common;

use common::squeeze::Squeeze;
use common::{coarse, fine};
use criterion::{Criterion, criterion_group, criterion_main};
use mammotwin_data::{Vec3, mesh::Patch, progress::Silent};
use mammotwin_solver::compress::Stops;
use mammotwin_solver::materials::Law;
use mammotwin_solver::paddles::{Outline, Paddle};
use mammotwin_solver::terms::{Bulk, Gravity};
use mammotwin_solver::{Model, Options, solve};

fn gravity(bench: &mut Criterion) {
    let mesh = fine().mesh;
    let law = Law::neo_hookean_coupled(0.5, 0.49).unwrap();
    let mut model = Model::new(&mesh);
    model.add(Bulk::new("breast", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
    model.add(Gravity::new("gravity", &mesh, 0.981 * 9.81 / 9.80665, Vec3::z())).unwrap();
    for node in mesh.patch_nodes(Patch::ChestWall) {
        model.fix_node(node);
    }
    bench.bench_function("gravity/20k", |b| {
        b.iter(|| solve(&model, &mesh.points, &Options::default(), &Silent).unwrap());
    });
}

/// A rigid paddle, in steps of so many millimetres.
fn to_50_mm(step_mm: f64) -> Squeeze {
    Squeeze {
        law: Law::neo_hookean_coupled(0.5, 0.49).unwrap(),
        radius_mm: 10.0,
        paddle: Paddle::Rigid,
        outline: Outline::ENDLESS,
        middle_mm: 0.0,
        friction: 0.0,
        step_mm,
        stops: Stops::at_thickness(50.0),
    }
}

fn compression(bench: &mut Criterion) {
    let body = coarse();
    let squeeze = to_50_mm(5.0);
    bench.bench_function("compression/5k", |b| b.iter(|| squeeze.press(&body)));
}

/// 20 points of a curve of force and thickness.
fn curve(bench: &mut Criterion) {
    let body = fine();
    let squeeze = to_50_mm((132.0 - 50.0) / 19.0);
    bench.bench_function("curve of 20 points/20k", |b| b.iter(|| squeeze.press(&body)));
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = gravity, compression, curve
}
criterion_main!(benches);
