//! Time of one assembly of gradient and matrix: 20 thousand linear tetrahedra, one law each; with all cores,
//! and processor time with one.

#![allow(missing_docs, clippy::unwrap_used)] // a benchmark may fail at once

#[path = "../tests/common/mod.rs"]
mod common;

use common::fine;
use criterion::{Criterion, criterion_group, criterion_main};
use mammotwin_data::study::LawName;
use mammotwin_solver::Model;
use mammotwin_solver::assemble::{Assembly, State};
use mammotwin_solver::materials::Law;
use mammotwin_solver::terms::{Bulk, Curvature, Load};
use std::time::{Duration, Instant};

/// Time that this thread has been on a core: other work on the machine does not count. Linux alone tells.
fn on_core() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
}

fn assembly(bench: &mut Criterion) {
    let mesh = fine().mesh;
    let points = mesh.points.iter().map(|p| 1.01 * p + 0.1 * p.yzx()).collect::<Vec<_>>();
    let laws = [
        ("neo_hookean", Law::new(LawName::NeoHookean, 0.5, 0.49, None).unwrap()),
        ("gent", Law::new(LawName::Gent, 0.5, 0.49, Some(2.0)).unwrap()),
    ];
    for (name, law) in laws {
        let mut model = Model::new(&mesh);
        model.add(Bulk::new("breast", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
        let mut assembly = Assembly::new(&model).unwrap();
        let state = State::new(&model, points.clone(), Load::GRAVITY);
        let (mut gradient, mut values, mut pressure) = (Vec::new(), Vec::new(), Vec::new());
        let mut system = || {
            let exact = Curvature::Exact;
            assembly.newton_system(&model, &state, exact, &mut gradient, &mut values).unwrap();
        };
        bench.bench_function(&format!("newton_system/{name}"), |b| b.iter(&mut system));
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        bench.bench_function(&format!("newton_system/{name}/one_core"), |b| {
            b.iter_custom(|times| {
                one.install(|| {
                    let (clock, before) = (Instant::now(), on_core());
                    (0..times).for_each(|_| system());
                    on_core().zip(before).map_or(clock.elapsed(), |(after, before)| after - before)
                })
            });
        });
        bench.bench_function(&format!("energy/{name}"), |b| {
            b.iter(|| assembly.energy(&model, &state, &points, &mut pressure).unwrap());
        });
    }
}

criterion_group!(benches, assembly);
criterion_main!(benches);
