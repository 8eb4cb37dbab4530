//! Time of a noise-free picture of the full detector.

#![allow(missing_docs)] // of the functions that criterion makes

use criterion::{Criterion, criterion_group, criterion_main};
use mammotwin_data::study::MammogramPlan;
use mammotwin_imaging::xray::{
    calibration::Unit, exposure::transmission, phantom::Phantom, project::project, shapes::Rounded,
};
use std::time::Duration;

/// A large compressed breast of 69 k triangles.
const BREAST: Rounded = Rounded {
    extent_mm: [115.0, 120.0],
    thickness_mm: 60.0,
    top_mm: 60.0,
    slope: 0.0,
    behind_mm: 0.0,
};

fn projection(criterion: &mut Criterion) {
    let unit = Unit::pristina(0.1, 24.0);
    let plan = MammogramPlan::default();
    let phantom = Phantom::new(BREAST.surface(360, 96), None, BREAST.thickness_mm, &plan, 0.3, 1)
        .expect("a breast");
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
