//! Photons per second of the Monte Carlo code, one thread: seconds of the processor, so that other
//! programs on the machine do not count.

#![allow(missing_docs)] // of the functions that criterion makes

use criterion::{
    Criterion, Throughput, criterion_group, criterion_main,
    measurement::{Measurement, ValueFormatter, WallTime},
};
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
use std::time::{Duration, Instant};

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

/// Time that this thread had a processor, where the system tells it (Linux); that of the clock
/// elsewhere.
struct Processor(WallTime);

impl Measurement for Processor {
    type Intermediate = (Option<Duration>, Instant);
    type Value = Duration;

    fn start(&self) -> Self::Intermediate {
        (on_processor(), Instant::now())
    }

    fn end(&self, (before, clock): Self::Intermediate) -> Duration {
        before.zip(on_processor()).map_or_else(|| clock.elapsed(), |(before, now)| now - before)
    }

    fn add(&self, a: &Duration, b: &Duration) -> Duration {
        *a + *b
    }

    fn zero(&self) -> Duration {
        Duration::ZERO
    }

    fn to_f64(&self, value: &Duration) -> f64 {
        value.as_nanos() as f64
    }

    fn formatter(&self) -> &dyn ValueFormatter {
        self.0.formatter()
    }
}

fn on_processor() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(Duration::from_nanos(text.split_whitespace().next()?.parse().ok()?))
}

fn photons(criterion: &mut Criterion<Processor>) {
    // This thread does the work: its time is what is measured.
    let builder = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
    let pool = builder.build().expect("a pool of this thread");
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

fn on_this_thread() -> Criterion<Processor> {
    Criterion::default().with_measurement(Processor(WallTime))
}

criterion_group!(name = benches; config = on_this_thread(); targets = photons);
criterion_main!(benches);
