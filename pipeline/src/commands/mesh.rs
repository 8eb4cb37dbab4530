//! `mammotwin study mesh`: what the size of the elements does to the answers.

use super::{rising, write};
use crate::{cli::MeshArguments, display::Task};
use mammotwin_data::{Failure, progress::Progress, store::peak_memory_bytes};
use mammotwin_stages::{
    force_curve::trial::Person,
    mesh_study::{Answers, QUANTITIES, Question, answers, limit},
    report::chart::{Axis, Chart, Line, lines},
};
use std::{fmt::Write, fs, time::Instant};

/// A mesh that is done.
struct Done {
    answers: Answers,
    seconds: f64,
    /// Most memory (MB) of the program until then: meshes go from coarse to fine.
    memory_mb: f64,
}

/// Computes coarse to fine meshes; writes `mesh.csv`, `mesh.md` and `mesh.svg` after each.
pub fn mesh(arguments: &MeshArguments) -> Result<(), Failure> {
    let mut sizes = rising("--sizes", &arguments.sizes, [2.0, 40.0])?;
    sizes.reverse();
    rising("--distance-mm", &[arguments.distance_mm], [0.0, 100.0])?;
    rising("--thickness-mm", &[arguments.thickness_mm], [5.0, 200.0])?;
    let out = &arguments.out;
    fs::create_dir_all(out).map_err(|cause| Failure::io(out, cause))?;
    let task = Task::new("meshes");
    let person = Person { preset: arguments.preset.clone(), seed: arguments.seed, stiffer: 1.0 };
    let question = Question {
        distance_mm: arguments.distance_mm,
        thickness_mm: (!arguments.gravity_only).then_some(arguments.thickness_mm),
    };
    // Work grows about as the fourth power of the fineness.
    let work: Vec<f64> = sizes.iter().map(|size| size.powi(-4)).collect();
    let whole: f64 = work.iter().sum();
    let mut done: Vec<Done> = Vec::new();
    for (n, &size_mm) in sizes.iter().enumerate() {
        let part = work[..n].iter().sum::<f64>() / whole;
        task.report(part, &format!("elements of {size_mm} mm"));
        let clock = Instant::now();
        let answers = answers(&person, size_mm, &question)?;
        let (seconds, memory_mb) =
            (clock.elapsed().as_secs_f64(), peak_memory_bytes() as f64 / 1e6);
        done.push(Done { answers, seconds, memory_mb });
        write(&out.join("mesh.csv"), csv(&done))?;
        write(&out.join("mesh.md"), markdown(&done, arguments))?;
        write(&out.join("mesh.svg"), chart(&done))?;
    }
    drop(task);
    tell!("{}", out.join("mesh.md").display());
    Ok(())
}

fn csv(done: &[Done]) -> String {
    let asked = done.first().map_or(0, |first| first.answers.values.len());
    let keys: Vec<&str> = QUANTITIES[..asked].iter().map(|quantity| quantity.key).collect();
    let mut text = format!(
        "size_mm,nodes,tets,{},iterations_gravity,iterations_compression,seconds,peak_memory_mb\n",
        keys.join(",")
    );
    for Done { answers, seconds, memory_mb } in done {
        let Answers { size_mm, nodes, tets, values, iterations: [hanging, pressed] } = answers;
        let values: Vec<String> = values.iter().map(f64::to_string).collect();
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{size_mm},{nodes},{tets},{},{hanging},{pressed},{seconds:.1},{memory_mb:.0}",
            values.join(",")
        );
    }
    text
}

/// Sizes, and the answers to one question over them.
fn course(done: &[Done], number: usize) -> (Vec<f64>, Vec<f64>) {
    done.iter().map(|done| (done.answers.size_mm, done.answers.values[number])).unzip()
}

fn markdown(done: &[Done], arguments: &MeshArguments) -> String {
    let MeshArguments { preset, seed, distance_mm, thickness_mm, gravity_only, .. } = arguments;
    let sizes: Vec<String> = done.iter().map(|done| done.answers.size_mm.to_string()).collect();
    let pressed = if *gravity_only {
        " --gravity-only".into()
    } else {
        format!(" --distance-mm {distance_mm} --thickness-mm {thickness_mm}")
    };
    let mut page = format!(
        "# What the size of the elements does\n\nMade by `mammotwin study mesh --preset {preset} --seed {seed} --sizes {}{pressed}`. Linear \
         tetrahedra, all cut from one lattice, on the shape in which the volunteer is free of stress; her own \
         chest wall, skin and ligaments. *Limit* and *order* are of the curve limit + c hᵖ of least squares through all \
         sizes h; *scatter* is the largest distance of an answer from it over the largest from the limit. Times are of a \
         machine that may have had other work; memory is the most of the program until then.\n\n| edges (mm) | nodes | tetrahedra |",
        sizes.join(",")
    );
    let asked = done.first().map_or(0, |first| first.answers.values.len());
    for quantity in &QUANTITIES[..asked] {
        let unit = if quantity.unit.is_empty() { "–" } else { quantity.unit };
        let _ = write!(page, " {} ({unit}) |", quantity.name);
    }
    page += " iterations, hanging and pressed | s | MB |\n|";
    page += &"---|".repeat(asked + 6);
    page += "\n";
    for Done { answers, seconds, memory_mb } in done {
        let Answers { size_mm, nodes, tets, values, iterations: [hanging, pressed] } = answers;
        let _ = write!(page, "| {size_mm} | {nodes} | {tets} |");
        for value in values {
            let _ = write!(page, " {value:.3} |");
        }
        let _ = writeln!(page, " {hanging}, {pressed} | {seconds:.0} | {memory_mb:.0} |");
    }
    page += "\n| answer | limit | order | scatter | finest off by |\n|---|---|---|---|---|\n";
    for (n, quantity) in QUANTITIES[..asked].iter().enumerate() {
        let (sizes_mm, values) = course(done, n);
        let Some(found) = limit(&sizes_mm, &values) else { continue };
        let finest = values.last().copied().unwrap_or(f64::NAN);
        let _ = writeln!(
            page,
            "| {} | {:.3} {} | {:.2} | {:.2} | {:.1} % |",
            quantity.name,
            found.limit,
            quantity.unit,
            found.order,
            found.scatter,
            100.0 * (finest / found.limit - 1.0)
        );
    }
    page + "\n![Answers over the size of the elements](mesh.svg)\n"
}

/// Every answer over that of the finest mesh.
fn chart(done: &[Done]) -> String {
    let asked = done.first().map_or(0, |first| first.answers.values.len());
    let line = |n: usize| {
        let (sizes, values) = course(done, n);
        let finest = values.last().copied().unwrap_or(f64::NAN);
        let points = sizes.into_iter().zip(values.iter().map(|value| 100.0 * value / finest));
        Line { name: QUANTITIES[n].short.into(), points: points.collect() }
    };
    lines(&Chart {
        title: "Answers over the size of the elements".into(),
        caption: String::new(),
        x_label: "edges of the elements (mm)".into(),
        y_label: "of the finest mesh's (%)".into(),
        lines: (0..asked).map(line).collect(),
        marks: Vec::new(),
        x_axis: Axis::Falling,
    })
}
