//! Time of a noise-free picture of the full detector.

#![allow(missing_docs)] // of the functions that criterion makes

use criterion::{Criterion, criterion_group, criterion_main};
use mammotwin_data::{Vec3, study::MammogramPlan, surface::TriMesh};
use mammotwin_imaging::xray::{
    calibration::Unit, exposure::transmission, phantom::Phantom, project::project,
};
use std::time::Duration;

/// A large compressed breast, 230 mm wide and 120 mm long, 60 mm thick, of 69 k triangles.
fn breast() -> TriMesh {
    let (around, up) = (360u32, 96u32);
    let half = 30.0;
    let mut points = vec![];
    for k in 0..=up {
        let angle = std::f64::consts::PI * (f64::from(k) / f64::from(up) - 0.5);
        let (z, out) = (half + half * angle.sin(), half * angle.cos() - half);
        for n in 0..=around {
            let turn = std::f64::consts::PI * f64::from(n) / f64::from(around);
            points.push(Vec3::new((115.0 + out) * turn.cos(), (120.0 + out) * turn.sin(), z));
        }
    }
    let at = |k: u32, n: u32| k * (around + 1) + n;
    let mut triangles = vec![];
    for k in 0..up {
        for n in 0..around {
            triangles.push([at(k, n), at(k, n + 1), at(k + 1, n + 1)]);
            triangles.push([at(k, n), at(k + 1, n + 1), at(k + 1, n)]);
        }
        triangles.push([at(k, around), at(k, 0), at(k + 1, 0)]);
        triangles.push([at(k, around), at(k + 1, 0), at(k + 1, around)]);
    }
    for n in 1..around {
        triangles.push([at(0, 0), at(0, n + 1), at(0, n)]);
        triangles.push([at(up, 0), at(up, n), at(up, n + 1)]);
    }
    TriMesh { points, triangles }
}

fn projection(criterion: &mut Criterion) {
    let unit = Unit::pristina(0.1, 24.0);
    let plan = MammogramPlan::default();
    let phantom = Phantom::new(breast(), 60.0, &plan, 0.3, 1).expect("a breast");
    let mut group = criterion.benchmark_group("2850 x 2394 pixels, noise-free");
    group.sample_size(10).measurement_time(Duration::from_secs(10));
    group.bench_function("path lengths", |b| {
        b.iter(|| project(&phantom, &unit.geometry).expect("a projection"));
    });
    group.bench_function("path lengths and transmission", |b| {
        b.iter(|| {
            let projection = project(&phantom, &unit.geometry).expect("a projection");
            transmission(&phantom, &projection, &unit).expect("tabulated")
        });
    });
    group.finish();
}

criterion_group!(benches, projection);
criterion_main!(benches);
