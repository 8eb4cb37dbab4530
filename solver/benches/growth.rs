//! How time and memory of one equilibrium grow with the mesh: a block of 160 x 160 x 80 mm that hangs from its fixed upper
//! side, E = 2 kPa, ν = 0.49, in 20 k, 65 k, 200 k, 500 k, 720 k and 1 M linear tetrahedra.
//!
//! `cargo bench --bench growth -- 200` stops at 200 thousand. The memory is the most that the program ever had, so that
//! sizes go up. One run each: the table is of orders of growth, not of per cents.

#![allow(missing_docs, clippy::unwrap_used)] // a benchmark may fail at once

#[path = "../tests/common/mod.rs"]
mod common;

use common::shapes::brick;
use mammotwin_data::{Vec3, mesh::Patch, progress::Silent};
use mammotwin_solver::materials::Law;
use mammotwin_solver::terms::{Bulk, Gravity};
use mammotwin_solver::{Model, Options, solve};
use std::time::Instant;

/// Thousands of tetrahedra.
const SIZES: [usize; 6] = [20, 65, 200, 500, 720, 1000];

/// Most memory (MB) that this process ever had; Linux alone tells.
fn peak_mb() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kb| kb / 1024.0)
}

/// Processor time (s) of all threads, in ticks of 10 ms.
fn processor_s() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    let after = text.rsplit(')').next()?;
    let ticks: Vec<&str> = after.split_whitespace().collect();
    Some((ticks.get(11)?.parse::<f64>().ok()? + ticks.get(12)?.parse::<f64>().ok()?) / 100.0)
}

fn main() {
    let most = std::env::args().filter_map(|word| word.parse().ok()).next_back().unwrap_or(65);
    println!("| tetrahedra | nodes | iterations | wall (s) | processor (s) | peak memory (MB) |");
    println!("|---|---|---|---|---|---|");
    for size in SIZES.into_iter().filter(|&size| size <= most) {
        // 6 tetrahedra a cube, twice as many cubes along the sides as in height: 24 n³ of them.
        let n = (1e3 * size as f64 / 24.0).cbrt().round() as usize;
        let step = 80.0 / n as f64;
        let mesh =
            brick([2 * n, 2 * n, n], |i, j, l| step * Vec3::new(i as f64, j as f64, l as f64));
        let law = Law::neo_hookean_coupled(2.0, 0.49).unwrap();
        let mut model = Model::new(&mesh);
        model.add(Bulk::new("block", &mesh, vec![law; mesh.tets.len()]).unwrap()).unwrap();
        model.add(Gravity::new("gravity", &mesh, 0.981, Vec3::z())).unwrap();
        for node in mesh.patch_nodes(Patch::ChestWall) {
            model.fix_node(node);
        }
        let (clock, before) = (Instant::now(), processor_s());
        let found = solve(&model, &mesh.points, &Options::default(), &Silent).unwrap();
        let wall_s = clock.elapsed().as_secs_f64();
        let processor_s = processor_s().zip(before).map_or(f64::NAN, |(now, then)| now - then);
        println!(
            "| {} | {} | {} | {wall_s:.1} | {processor_s:.1} | {:.0} |",
            mesh.tets.len(),
            mesh.points.len(),
            found.checks.iterations,
            peak_mb().unwrap_or(f64::NAN),
        );
    }
}
