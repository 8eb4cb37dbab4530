//! `mammotwin study search-box`: whether the solver finds an equilibrium wherever a calibration may go.

mod page;

use super::write;
use crate::{cli::SearchBoxArguments, display::Task};
use mammotwin_data::{Failure, progress::Progress};
use mammotwin_stages::search_box::{Case, Found, SHAPES, Shape, design};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
    time::{Duration, Instant},
};

/// A run that is done, as it is kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Done {
    /// Program that made it.
    version: String,
    /// Edges of the mesh (mm).
    size_mm: f64,
    /// Number of tetrahedra.
    tets: usize,
    case: Case,
    found: Found,
    /// Time (s) that it took, on a machine that may have had other work.
    seconds: f64,
}

impl Done {
    /// The kept run of a case, if it is there and this program's.
    fn kept(path: &Path, case: &Case, size_mm: f64) -> Option<Self> {
        let done: Self = serde_json::from_slice(&fs::read(path).ok()?).ok()?;
        let same = done.case == *case && done.size_mm == size_mm && done.version == VERSION;
        same.then_some(done)
    }

    /// Keeps it: a file that was cut short is never taken for a whole one.
    fn keep(&self, path: &Path) -> Result<(), Failure> {
        let text = serde_json::to_vec_pretty(self).map_err(|cause| Failure::io(path, cause))?;
        let aside = path.with_extension("part");
        write(&aside, text)?;
        fs::rename(&aside, path).map_err(|cause| Failure::io(path, cause))
    }
}

/// Program and way of solving: raised whenever the solver steps or ends otherwise, so that no older run is kept.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), ", solver 5");

/// Computes the runs that are missing, and writes `runs.csv`, `search-box.md` and `search-box.svg`.
pub fn search_box(arguments: &SearchBoxArguments) -> Result<(), Failure> {
    let SearchBoxArguments { out, runs, size_mm, .. } = arguments;
    if !(1..=100_000).contains(runs) {
        return Err(Failure::Usage("--runs: give 1 to 100000".into()));
    }
    if !(5.0..=30.0).contains(size_mm) {
        return Err(Failure::Usage("--size-mm: give 5 to 30 mm".into()));
    }
    let folder = out.join("runs");
    fs::create_dir_all(&folder).map_err(|cause| Failure::io(&folder, cause))?;
    let cases = design(*runs, arguments.stepped_every, arguments.seed);
    let file = |n: usize| folder.join(format!("{n:04}.json"));
    let kept = |n: usize| Done::kept(&file(n), &cases[n], *size_mm);
    let missing: Vec<usize> = (0..*runs).filter(|&n| kept(n).is_none()).collect();
    let end = arguments.minutes.map(|minutes| Instant::now() + Duration::from_secs(60 * minutes));
    let late = || end.is_some_and(|end| Instant::now() >= end);
    if !missing.is_empty() {
        let task = Task::new("search box");
        task.report(0.0, "meshes");
        let shapes = (0..SHAPES.len()).map(|shape| Shape::new(shape, *size_mm));
        let shapes = shapes.collect::<Result<Vec<_>, _>>()?;
        let count = AtomicUsize::new(0);
        missing.par_iter().with_max_len(1).try_for_each(|&n| {
            if late() {
                return Ok(());
            }
            let (case, clock) = (&cases[n], Instant::now());
            let shape = &shapes[case.shape];
            let found = case.run(shape)?;
            let done = Done {
                version: VERSION.into(),
                size_mm: *size_mm,
                tets: shape.tets(),
                case: case.clone(),
                found,
                seconds: clock.elapsed().as_secs_f64(),
            };
            done.keep(&file(n))?;
            let count = count.fetch_add(1, Ordering::Relaxed) + 1;
            let share = count as f64 / missing.len() as f64;
            task.report(share, &format!("{count} of {}", missing.len()));
            Ok::<(), Failure>(())
        })?;
    }
    let done: Vec<(usize, Done)> = (0..*runs).filter_map(|n| Some((n, kept(n)?))).collect();
    let page = page::markdown(&done, arguments);
    write(&out.join("runs.csv"), page::csv(&done))?;
    write(&out.join("search-box.svg"), page::chart(&done))?;
    write(&out.join("search-box.md"), &page)?;
    let faults = done.iter().filter(|(_, run)| !run.found.faults().is_empty()).count();
    tell!("{} of {runs} runs done, {faults} with a fault", done.len());
    tell!("{}", out.join("search-box.md").display());
    Ok(())
}
