//! Photons per second of the Monte Carlo code, one thread.

#![allow(missing_docs)] // of the functions that criterion makes

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mammotwin_data::{Vec3, surface::TriMesh};
use mammotwin_imaging::xray::{
    geometry::Geometry,
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

/// A breast between plates as a closed surface: half an ellipse of 150 x 90 mm with round sides.
fn breast(thickness: f64) -> TriMesh {
    let (around, up) = (120u32, 24u32);
    let half = 0.5 * thickness;
    let mut points = vec![];
    for k in 0..=up {
        let angle = std::f64::consts::PI * (f64::from(k) / f64::from(up) - 0.5);
        let (z, out) = (half + half * angle.sin(), half * angle.cos() - half);
        for n in 0..=around {
            let turn = std::f64::consts::PI * f64::from(n) / f64::from(around);
            points.push(Vec3::new((75.0 + out) * turn.cos(), (90.0 + out) * turn.sin(), z));
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
