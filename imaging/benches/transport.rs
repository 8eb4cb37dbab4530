//! Photons per second of the Monte Carlo code, one thread.

#![allow(missing_docs)] // of the functions that criterion makes

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mammotwin_data::surface::TriMesh;
use mammotwin_imaging::xray::{
    geometry::Geometry,
    shapes::Rounded,
    spectrum::Spectrum,
    transport::{
        bodies::{Closed, HalfCylinder},
        exam::{Exam, MEDIA, Setup, examine},
        photon::Histories,
        scene::Body,
    },
};
use std::time::Duration;

const PHOTONS: u64 = 1_000_000;

/// A breast between plates: half an ellipse of 150 x 90 mm with round sides.
fn breast(thickness_mm: f64) -> TriMesh {
    let extent_mm = [75.0, 90.0];
    let shape =
        Rounded { extent_mm, thickness_mm, top_mm: thickness_mm, slope: 0.0, behind_mm: 0.0 };
    shape.surface(120, 24)
}

/// Dose and scatter image with grid.
fn exam(body: impl Body) -> Exam {
    let tube = Spectrum::of_tube("Rh/Ag", 34).expect("the table has it");
    let setup = Setup::usual(0.2).expect("tabulated");
    let histories = Histories { photons: PHOTONS, seed: 1 };
    examine(body, &setup, &Geometry::pristina(0.1), &tube, histories).expect("an exam")
}

fn photons(criterion: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let mut group = criterion.benchmark_group("photons that enter the breast");
    group.sample_size(10).measurement_time(Duration::from_secs(10));
    let closed = Closed::new(&breast(46.0), 2.0, 1.45, MEDIA).expect("closed");
    let half =
        HalfCylinder { radius: 80.0, bottom: 0.0, top: 46.0, slope: 0.0, skin: 1.45, media: MEDIA };
    let one = |body: &HalfCylinder| pool.install(|| exam(body.clone()));
    group.throughput(Throughput::Elements(one(&half).tally.entered));
    group.bench_function("half cylinder", |b| b.iter(|| one(&half)));
    let one = |body: &Closed| pool.install(|| exam(body.clone()));
    group.throughput(Throughput::Elements(one(&closed).tally.entered));
    group.bench_function("deformed breast", |b| b.iter(|| one(&closed)));
    group.finish();
}

criterion_group!(benches, photons);
criterion_main!(benches);
