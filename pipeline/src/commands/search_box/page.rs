//! Table, figure and page of the search box.

use super::Done;
use crate::cli::SearchBoxArguments;
use mammotwin_stages::{
    report::chart::{Axis, Chart, Line, lines},
    search_box::{
        Case, IMBALANCE, OPEN_MM, PATHS, RESIDUAL, SHAPES, SKEWNESS, STANDS_TO, State, VOLUME, Wall,
    },
    volunteer::PoseName,
};
use std::fmt::Write;

type Runs = [(usize, Done)];

/// All runs as CSV.
pub fn csv(runs: &Runs) -> String {
    let mut text = String::from(
        "run,shape,tets,pose,wall,breast_kpa,skin_kpa,fascia_kpa,poisson,jm,weight,ended,steps,iterations,\
         seconds,moved_mm,residual,force_imbalance,moment_imbalance,gap_mm,penetration_mm,min_det_f,\
         skewness_rest,skewness,volume_change,volume_change_by_law,in_three_parts,faults\n",
    );
    for (n, run) in runs {
        let Case { shape, wall, breast_kpa, skin_kpa, fascia_kpa, poisson, jm, .. } = &run.case;
        let jm = jm.map_or("inf".into(), |jm| jm.to_string());
        // Writing to a string does not fail.
        let _ = write!(
            text,
            "{n},{},{},{},{},{breast_kpa},{skin_kpa},{fascia_kpa},{poisson},{jm},{:.2},",
            SHAPES[*shape],
            run.tets,
            run.case.pose().name(),
            wall.name(),
            run.found.weight
        );
        let _ = match &run.found.end {
            Ok(State { checks, moved_mm, swollen, swollen_by_law, skewness, apart, .. }) => write!(
                text,
                "yes,{},{},{:.2},{moved_mm:.3},{:.2e},{:.2e},{:.2e},{:.4},{:.4},{:.4},{:.4},{:.4},{swollen:.5},\
                 {swollen_by_law:.5},{},",
                checks.steps,
                checks.iterations,
                run.seconds,
                checks.residual,
                checks.force_imbalance,
                checks.moment_imbalance,
                checks.max_gap_mm,
                checks.max_penetration_mm,
                checks.min_det_f,
                skewness[0],
                skewness[1],
                apart.map_or(String::new(), |apart| format!("{apart:.2e}"))
            ),
            Err(_) if run.found.has_no_stable_state() => {
                write!(text, "no_stable_state,,,{:.2},,,,,,,,,,,,,", run.seconds)
            }
            Err(_) => write!(text, "no,,,{:.2},,,,,,,,,,,,,", run.seconds),
        };
        let faults = run.found.faults().join("; ").replace([',', '\n'], ";");
        let _ = writeln!(text, "{faults}");
    }
    text
}

/// Share of the runs over the Newton iterations that they took.
pub fn chart(runs: &Runs) -> String {
    let line = |wall: &Wall| {
        let own = runs.iter().filter(|(_, run)| run.case.wall == *wall);
        let ended = own.filter_map(|(_, run)| run.found.end.as_ref().ok());
        let mut all: Vec<f64> = ended.map(|state| state.checks.iterations as f64).collect();
        all.sort_by(f64::total_cmp);
        let share = |n: usize| 100.0 * (n + 1) as f64 / all.len() as f64;
        let points = all.iter().enumerate().map(|(n, count)| (share(n), count.log10())).collect();
        Line { name: wall.name().into(), points }
    };
    lines(&Chart {
        title: "Newton iterations of a run".into(),
        caption: String::new(),
        x_label: "runs with no more (%)".into(),
        y_label: "log10 of the Newton iterations".into(),
        lines: Wall::ALL.iter().map(line).collect(),
        marks: Vec::new(),
        x_axis: Axis::Rising,
    })
}

/// The page.
pub fn markdown(runs: &Runs, arguments: &SearchBoxArguments) -> String {
    let SearchBoxArguments { runs: wanted, seed, size_mm, stepped_every, .. } = arguments;
    let mut page = format!(
        "# The search box\n\nMade by `mammotwin study search-box --runs {wanted} --seed {seed} --size-mm {size_mm} \
         --stepped-every {stepped_every}`. \
         Does every set of tissues that a calibration may meet end in equilibrium? A Latin hypercube over breast \
         0.2 - 4, skin 2 - 20, fascia 50 - 250 kPa, ν 0.45 - 0.499 and Jₘ 1 to none (Gent; neo-Hookean for none), in \
         all combinations of two shapes ({}), four poses and five chest walls: bonded to a rigid muscle, sliding on it without \
         friction and against friction of 0.1, bonded to a muscle of 10 kPa, and sliding on that without friction; nothing that \
         slides lifts off. Each run loads the stress-free \
         shape with all of gravity at once.\n\n",
        SHAPES.join(", ")
    );
    let tets = |shape: usize| runs.iter().find(|(_, run)| run.case.shape == shape);
    for shape in 0..SHAPES.len() {
        if let Some((_, run)) = tets(shape) {
            let _ = writeln!(page, "- `{}`: {} linear tetrahedra", SHAPES[shape], run.tets);
        }
    }
    let _ = writeln!(
        page,
        "\nA run is sound when its residual is at most {RESIDUAL:.0e}, forces and moments sum to at most {} % of the \
         largest, gaps and penetrations are at most {OPEN_MM} mm, the volume is that of the law under the mean \
         stress to {} % of the whole, and, for one in {} of each combination, loading in three parts leads to the same \
         shape to {} % of the largest displacement. Without an equilibrium it is sound only where ρ g H / μ is over \
         {STANDS_TO} (H: how far the breast stands out from the muscle) and the solver met a state from which the energy falls \
         and nothing that stops it.\n",
        1e2 * IMBALANCE,
        1e2 * VOLUME,
        arguments.stepped_every.max(1),
        1e2 * PATHS
    );
    let all = |of: &dyn Fn(&Done) -> bool| runs.iter().filter(|(_, run)| of(run)).count();
    let ended = |run: &Done| run.found.end.is_ok();
    let heavy = |run: &Done| run.found.weight > STANDS_TO;
    let tried = |run: &Done| {
        run.found.end.as_ref().is_ok_and(|s| s.apart.is_some() || s.apart_failed.is_some())
    };
    let sound = |run: &Done| run.found.faults().is_empty();
    page += "| | runs |\n|---|---|\n";
    for (what, count) in [
        ("drawn", *wanted),
        ("computed", runs.len()),
        ("in equilibrium", all(&ended)),
        (
            "no stable state, ρ g H / μ over 7: `no_stable_state`",
            all(&|r| r.found.has_no_stable_state()),
        ),
        ("no equilibrium otherwise", all(&|r| !ended(r) && !r.found.has_no_stable_state())),
        ("ρ g H / μ over 7, yet in equilibrium", all(&|r| ended(r) && heavy(r))),
        ("also loaded in three parts", all(&tried)),
        ("elements beyond skewness 0.95 when deformed", all(&|r| r.found.is_stretched())),
        ("**sound**", all(&sound)),
        ("**with a fault**", runs.len() - all(&sound)),
    ] {
        let _ = writeln!(page, "| {what} | {count} |");
    }
    page += "\n## By shape, chest wall and pose\n\n| shape | wall | pose | runs | in equilibrium | sound | load steps, \
             most | iterations, median and most | seconds, median and most | least det F | largest skewness | \
             largest difference in three parts |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n";
    for (shape, name) in SHAPES.iter().enumerate() {
        for wall in Wall::ALL {
            for pose in PoseName::ALL {
                let own = |run: &&(usize, Done)| {
                    let case = &run.1.case;
                    (case.shape, case.wall, case.pose()) == (shape, wall, pose)
                };
                row(
                    &mut page,
                    &runs.iter().filter(own).collect::<Vec<_>>(),
                    [name, wall.name(), pose.name()],
                );
            }
        }
    }
    page += "\nSeconds are those of a shared machine, two runs at a time, with the load in three parts where that was \
             tried.\n\n![Newton iterations](search-box.svg)\n\n## Every fault\n\n";
    faults(&mut page, runs);
    let _ = writeln!(
        page,
        "\n## Not in it\n\n- friction on a muscle that gives way;\n- quadratic elements, and other meshes than \
         these;\n- remeshing: runs whose elements are stretched beyond skewness {SKEWNESS} say so and go on."
    );
    page
}

fn row(page: &mut String, runs: &[&(usize, Done)], names: [&str; 3]) {
    let states: Vec<&State> = runs.iter().filter_map(|(_, r)| r.found.end.as_ref().ok()).collect();
    let sound = runs.iter().filter(|(_, r)| r.found.faults().is_empty()).count();
    let middle = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        [all.get(all.len() / 2), all.last()].map(|v| v.copied().unwrap_or(f64::NAN))
    };
    let most = |of: &dyn Fn(&State) -> f64| states.iter().map(|s| of(s)).fold(0.0, f64::max);
    let iterations = middle(states.iter().map(|s| s.checks.iterations as f64).collect());
    let seconds = middle(runs.iter().map(|(_, r)| r.seconds).collect());
    let least = states.iter().map(|s| s.checks.min_det_f).fold(f64::INFINITY, f64::min);
    let [shape, wall, pose] = names;
    // Writing to a string does not fail.
    let _ = writeln!(
        page,
        "| {shape} | {wall} | {pose} | {} | {} | {sound} | {:.0} | {:.0}, {:.0} | {:.1}, {:.1} | {least:.2} | \
         {:.2} | {:.1e} |",
        runs.len(),
        states.len(),
        most(&|s| s.checks.steps as f64),
        iterations[0],
        iterations[1],
        seconds[0],
        seconds[1],
        most(&|s| s.skewness[1]),
        most(&|s| s.apart.unwrap_or(0.0))
    );
}

fn faults(page: &mut String, runs: &Runs) {
    let faulty = || runs.iter().filter(|(_, run)| !run.found.faults().is_empty());
    if faulty().next().is_none() {
        page.push_str("None.\n");
        return;
    }
    page.push_str(
        "| run | shape | wall | pose | breast, skin, fascia (kPa) | ν | Jₘ | ρ g H / μ | carried | fault |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (n, run) in faulty() {
        let Case { shape, wall, breast_kpa, skin_kpa, fascia_kpa, poisson, jm, .. } = &run.case;
        let jm = jm.map_or("none".into(), |jm| format!("{jm:.2}"));
        let carried = run.found.end.as_ref().err().map_or(1.0, |stop| stop.carried);
        // Writing to a string does not fail.
        let _ = writeln!(
            page,
            "| {n} | {} | {} | {} | {breast_kpa:.2}, {skin_kpa:.1}, {fascia_kpa:.0} | {poisson:.4} | {jm} | {:.1} | \
             {:.1} % | {} |",
            SHAPES[*shape],
            wall.name(),
            run.case.pose().name(),
            run.found.weight,
            100.0 * carried,
            run.found.faults().join("; ").replace('|', "/")
        );
    }
}
