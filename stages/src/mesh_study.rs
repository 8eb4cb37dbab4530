//! What the size of the elements does to answers: one volunteer, hanging and compressed, on finer and finer
//! meshes (Mîra 2018, appendix B).

use crate::{
    comfort::{Weighted, percentile},
    force_curve::trial::{LARGEST_N, Meshed, Person},
    results::principal_stretches,
    volunteer::PoseName,
};
use mammotwin_data::{Failure, mesh::TetMesh, solution::Solution};
use mammotwin_solver::mesh::locate::Locator;

/// Depth (mm) under the tip of the right breast of the tissue whose way is measured.
const UNDER_TIP_MM: f64 = 10.0;
/// Part of the volume that is strained less than what is told.
const STRAINED: f64 = 0.95;

/// What is asked of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Question {
    /// Distance of the plates from the chest wall (mm).
    pub distance_mm: f64,
    /// Compressed thickness (mm); `None` for gravity alone.
    pub thickness_mm: Option<f64>,
}

/// What one mesh says.
#[derive(Debug, Clone, PartialEq)]
pub struct Answers {
    /// Edge length that was asked for (mm).
    pub size_mm: f64,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of linear tetrahedra.
    pub tets: usize,
    /// Each of [`QUANTITIES`] that was asked.
    pub values: Vec<f64>,
    /// Newton iterations of gravity, and of the compression.
    pub iterations: [usize; 2],
}

/// A number that is looked at over the size of the elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// In tables.
    pub key: &'static str,
    /// In plain words.
    pub name: &'static str,
    /// In the legend of a chart.
    pub short: &'static str,
    /// Unit; empty for none.
    pub unit: &'static str,
}

const fn quantity(
    key: &'static str,
    name: &'static str,
    short: &'static str,
    unit: &'static str,
) -> Quantity {
    Quantity { key, name, short, unit }
}

/// What is asked of every mesh; the last three with a compression alone.
pub const QUANTITIES: [Quantity; 6] = [
    quantity("tip_mm", "way of the tip, hanging", "tip", "mm"),
    quantity("strain_mean", "largest logarithmic strain, hanging, mean", "strain", ""),
    quantity("strain_p95", "the same, 95 % of the volume", "strain, 95 %", ""),
    quantity("force_n", "force of the paddle", "force", "N"),
    quantity(
        "pressed_strain_mean",
        "largest logarithmic strain, compressed, mean",
        "pressed, strain",
        "",
    ),
    quantity("pressed_strain_p95", "the same, 95 % of the volume", "pressed, 95 %", ""),
];

/// Hangs and presses a person on elements of `size_mm`.
///
/// # Errors
/// No such volunteer, no mesh of this size, or no equilibrium.
pub fn answers(person: &Person, size_mm: f64, question: &Question) -> Result<Answers, Failure> {
    let ready = person.meshed(Meshed::new(size_mm, 0))?;
    let mesh = ready.mesh();
    let hanging = ready.posed(PoseName::Prone)?;
    let tip = ready.tip(UNDER_TIP_MM);
    let found = Locator::new(&mesh.points, &mesh.tets).find(&tip).ok_or_else(|| {
        Failure::Numerics(format!("elements of {size_mm} mm: the tip of the breast is in none"))
    })?;
    let way_mm = (found.interpolate(&mesh.tets, &hanging.points) - tip).norm();
    let mut values = vec![way_mm];
    values.extend(strains(mesh, &hanging));
    let mut iterations = [hanging.checks.iterations, 0];
    if let Some(thickness_mm) = question.thickness_mm {
        let plan = person.plan(question.distance_mm, thickness_mm)?;
        let pressed = ready.compressed(&plan)?;
        let force_n = pressed.curve.force_n.last().copied().unwrap_or(f64::NAN);
        if !(pressed.thickness_mm < thickness_mm + 0.5) {
            return Err(Failure::Numerics(format!(
                "elements of {size_mm} mm: {LARGEST_N} N are reached at {:.1} mm",
                pressed.thickness_mm
            )));
        }
        values.push(force_n);
        values.extend(strains(&pressed.mesh, &pressed.solution));
        iterations[1] = pressed.solution.checks.iterations;
    }
    Ok(Answers { size_mm, nodes: mesh.points.len(), tets: mesh.tets.len(), values, iterations })
}

/// Mean of the largest logarithmic strain over the volume at rest, and what 95 % of it are below.
fn strains(mesh: &TetMesh, found: &Solution) -> [f64; 2] {
    let volumes = mesh.tets.iter().map(|tet| TetMesh::tet_volume(&mesh.points, tet));
    let strains = found.deformation_gradient.iter().map(|f| principal_stretches(f)[0].ln());
    let all: Vec<Weighted> = strains.zip(volumes).collect();
    let whole: f64 = all.iter().map(|(_, volume)| volume).sum();
    let mean = all.iter().map(|(strain, volume)| strain * volume).sum::<f64>() / whole;
    [mean, percentile(all, STRAINED)]
}

/// How an answer goes to its limit: q(h) = limit + c hᵖ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limit {
    /// Where it goes.
    pub limit: f64,
    /// The observed order p.
    pub order: f64,
    /// Largest distance of an answer from the curve, over the largest from the limit: near 1 the order says nothing.
    pub scatter: f64,
}

/// Orders that are tried.
const ORDERS: [f64; 2] = [0.25, 4.0];
const ORDER_STEP: f64 = 0.01;
/// Fewest meshes by which an order can be judged: one more than it has numbers.
const FEWEST: usize = 4;

/// The curve of least squares through answers over sizes (mm); `None` of fewer than four.
pub fn limit(sizes_mm: &[f64], answers: &[f64]) -> Option<Limit> {
    if sizes_mm.len() != answers.len() || sizes_mm.len() < FEWEST {
        return None;
    }
    let count = ((ORDERS[1] - ORDERS[0]) / ORDER_STEP).round() as usize;
    let of = |n: usize| {
        let order = ORDERS[0] + ORDER_STEP * n as f64;
        let powers: Vec<f64> = sizes_mm.iter().map(|size| size.powf(order)).collect();
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
        let (x, y) = (mean(&powers), mean(answers));
        let pairs = || powers.iter().zip(answers);
        let slope = pairs().map(|(a, b)| (a - x) * (b - y)).sum::<f64>()
            / powers.iter().map(|a| (a - x).powi(2)).sum::<f64>();
        let limit = y - slope * x;
        let off = || pairs().map(|(a, b)| (b - limit - slope * a).abs());
        let far = answers.iter().map(|b| (b - limit).abs()).fold(f64::MIN_POSITIVE, f64::max);
        let squares: f64 = off().map(|off| off * off).sum();
        (squares, Limit { limit, order, scatter: off().fold(0.0, f64::max) / far })
    };
    let best = (0..=count).map(of).min_by(|a, b| a.0.total_cmp(&b.0))?;
    best.1.limit.is_finite().then_some(best.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_is_read_off_a_power_law() {
        let sizes = [20.0, 17.0, 15.0, 13.0, 10.0, 7.0];
        let law = |size: &f64| 31.0 - 0.02 * size.powf(1.73);
        let found = limit(&sizes, &sizes.iter().map(law).collect::<Vec<_>>()).unwrap();
        assert!((found.order - 1.73).abs() < 0.006 && (found.limit - 31.0).abs() < 0.01);
        assert!(found.scatter < 1e-3);
        // Numbers that go nowhere say so.
        let noise = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0];
        assert!(limit(&sizes, &noise).unwrap().scatter > 0.5);
        assert!(limit(&sizes[..3], &noise[..3]).is_none());
    }

    #[test]
    fn a_finer_mesh_hangs_lower_and_strains_more() {
        let person = Person { preset: "tiny".into(), seed: 7, stiffer: 1.0 };
        let question = Question { distance_mm: 15.0, thickness_mm: Some(46.0) };
        let [coarse, fine] = [18.0, 12.0].map(|size| answers(&person, size, &question).unwrap());
        println!("{coarse:?}\n{fine:?}");
        assert_eq!(coarse.values.len(), QUANTITIES.len());
        assert!(fine.tets > 2 * coarse.tets);
        assert!(fine.values[0] > coarse.values[0] && coarse.values[0] > 1.0);
        // Its force has no order; strains have.
        assert!(fine.values[3] > 0.0 && coarse.values[3] > 0.0);
        for n in [1, 2, 4, 5] {
            assert!(fine.values[n] > coarse.values[n] && coarse.values[n] > 0.0);
        }
        assert!(fine.values[2] > fine.values[1] && fine.values[5] > fine.values[4]);
    }
}
