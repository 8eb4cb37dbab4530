//! The force of the other breast, foretold from what the record of one breast tells of Jₘ and the paddle's place.
//!
//! Both breasts have the same Jₘ and the paddle has the same place; moduli and shape of the other one are its own.
//! The unknown factor of all forces is drawn anew: what the first record tells of it is not carried over, since moduli
//! are fitted side by side.

use super::{Grid, Measured, Posterior, RecordError};
use mammotwin_stages::report::chart::{Axis, Chart, Line};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write;

/// Draws, and their seed.
const DRAWS: usize = 20_000;
const SEED: u64 = 1;
/// Largest share of the posterior that may not reach a thickness that is foretold.
const MISSING: f64 = 0.05;

/// A force that a unit would show at a thickness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foretold {
    /// Distance of the plates (mm).
    pub thickness_mm: f64,
    /// 5 % of the draws are below the first force (N), half below the second, 5 % above the third.
    pub force_n: [f64; 3],
}

/// Forces that a unit would show of a breast whose courses are `grid`, at each thickness (mm) that 95 % of the
/// posterior of the other breast reach.
pub fn foretell(
    grid: &Grid,
    posterior: &Posterior,
    error: &RecordError,
    thicknesses_mm: &[f64],
) -> Vec<Foretold> {
    let mut sum = 0.0;
    let sums: Vec<f64> = posterior
        .weights
        .iter()
        .map(|weight| {
            sum += weight;
            sum
        })
        .collect();
    let columns = posterior.distance_mm.len();
    let mut found = Vec::new();
    for &thickness_mm in thicknesses_mm {
        // The same draws at each thickness: the band is as smooth as the courses are.
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut forces = Vec::with_capacity(DRAWS);
        for _ in 0..DRAWS {
            let part: f64 = random.random::<f64>() * sum;
            let n = sums.partition_point(|sum| *sum < part).min(sums.len().saturating_sub(1));
            let [alike, own, shown, bent]: [f64; 4] =
                std::array::from_fn(|_| StandardNormal.sample(&mut random));
            let place = (posterior.jm[n / columns], posterior.distance_mm[n % columns]);
            let Some([force, slope]) = grid.force(place.0, place.1, thickness_mm) else { continue };
            let force = force * (1.0 + error.model_part * alike + error.bent_part * bent);
            let own = own * (error.force_part * force).hypot(error.force_n);
            forces.push((force + own + slope * error.thickness_mm * shown).max(0.0));
        }
        if (forces.len() as f64) < (1.0 - MISSING) * DRAWS as f64 {
            continue;
        }
        forces.sort_by(f64::total_cmp);
        let at = |share: f64| forces[(share * (forces.len() - 1) as f64).round() as usize];
        found.push(Foretold { thickness_mm, force_n: [at(0.05), at(0.5), at(0.95)] });
    }
    found
}

/// The foretold forces as CSV.
pub fn foretold_table(foretold: &[Foretold]) -> String {
    let mut text = String::from("thickness_mm,force_p05_n,force_median_n,force_p95_n\n");
    for Foretold { thickness_mm, force_n: [low, middle, high] } in foretold {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{thickness_mm:.3},{low:.6},{middle:.6},{high:.6}");
    }
    text
}

/// The band, and the record of that breast where there is one.
pub fn foretold_chart(side: &str, foretold: &[Foretold], record: Option<Measured>) -> Chart {
    let line = |name: &str, which: usize| Line {
        name: name.into(),
        points: foretold.iter().map(|f| (f.thickness_mm, f.force_n[which])).collect(),
    };
    let mut lines = vec![line("median", 1), line("5 %", 0), line("95 %", 2)];
    if let Some(Measured { thickness_mm, force_n }) = record {
        lines.push(Line { name: "record".into(), points: vec![(thickness_mm, force_n)] });
    }
    Chart {
        title: format!("Force of the {side} breast, foretold from the other one"),
        caption: String::new(),
        x_label: "thickness (mm)".into(),
        y_label: "force (N)".into(),
        lines,
        marks: Vec::new(),
        x_axis: Axis::Falling,
    }
}

/// What is foretold at a record, and whether it holds it.
pub fn foretold_said(side: &str, at: Option<&Foretold>, record: Measured) -> String {
    let Measured { thickness_mm, force_n } = record;
    let Some(Foretold { force_n: [low, middle, high], .. }) = at else {
        return format!(
            "The {side} breast took no part; {thickness_mm} mm, where its record is {force_n} N, is not reached \
             by the model."
        );
    };
    let holds = if (*low..=*high).contains(&force_n) { "holds" } else { "does not hold" };
    format!(
        "The {side} breast took no part: foretold at {thickness_mm} mm are {middle:.2} N (90 % between {low:.2} and \
         {high:.2} N), which {holds} its record of {force_n} N."
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::super::Course;
    use super::*;

    const JM: [f64; 7] = [0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0];
    const DISTANCE_MM: [f64; 4] = [10.0, 15.0, 20.0, 25.0];
    const ERROR: RecordError = RecordError {
        force_part: 0.03,
        force_n: 0.1,
        thickness_mm: 0.5,
        model_part: 0.1,
        bent_part: 0.0,
    };

    /// A breast of a size (mm): force (N) that grows the faster the smaller Jₘ is, and falls with the distance.
    fn force(size_mm: f64, jm: f64, distance_mm: f64, thickness_mm: f64) -> f64 {
        let pressed = (size_mm - thickness_mm) / 40.0;
        (size_mm / 2.0 - distance_mm) * pressed * (1.5 * pressed / jm).exp() / 10.0
    }

    fn grid(size_mm: f64) -> Grid {
        let thickness_mm: Vec<f64> = (0..=80).map(|n| size_mm - 0.5 * f64::from(n)).collect();
        let course = |jm: f64, d: f64| Course {
            force_n: thickness_mm.iter().map(|h| force(size_mm, jm, d, *h)).collect(),
            thickness_mm: thickness_mm.clone(),
        };
        let courses = JM.iter().flat_map(|j| DISTANCE_MM.iter().map(|d| Some(course(*j, *d))));
        Grid { courses: courses.collect(), jm: JM.to_vec(), distance_mm: DISTANCE_MM.to_vec() }
    }

    fn shown(size_mm: f64, factor: f64, h: f64, normal: &mut dyn FnMut() -> f64) -> Measured {
        let real = h + ERROR.thickness_mm * normal();
        let force = factor * force(size_mm, 1.2, 17.0, real);
        let force_n = force * (1.0 + ERROR.force_part * normal()) + ERROR.force_n * normal();
        Measured { thickness_mm: h, force_n }
    }

    /// Share of 150 pairs of breasts whose left record lies in the interval from the right one.
    fn held(alike: bool) -> f64 {
        let (right, left) = (grid(80.0), grid(86.0));
        let mut count = 0;
        for seed in 0..150 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            let factor = 1.0 + ERROR.model_part * normal();
            let record: Vec<Measured> = (0..8)
                .map(|n| shown(80.0, factor, 75.0 - 4.5 * f64::from(n), &mut normal))
                .collect();
            let posterior = right.posterior(&record, &ERROR).unwrap();
            let other = if alike { factor } else { 1.0 + ERROR.model_part * normal() };
            let truth = shown(86.0, other, 52.0, &mut normal);
            let [low, _, high] = foretell(&left, &posterior, &ERROR, &[52.0])[0].force_n;
            count += u32::from((low..=high).contains(&truth.force_n));
        }
        f64::from(count) / 150.0
    }

    #[test]
    fn the_interval_of_the_other_breast_holds_its_force_as_often_as_it_says() {
        let [apart, alike] = [held(false), held(true)];
        println!("held: {apart:.3} with a factor of its own, {alike:.3} with the same one");
        // 0.9 and three standard errors of 150 draws.
        assert!((0.826..=0.974).contains(&apart), "{apart}");
        assert!(alike >= 0.826, "{alike}");
    }

    #[test]
    fn what_the_courses_do_not_reach_is_not_foretold_and_a_sure_posterior_gives_the_course() {
        let left = grid(86.0);
        let posterior =
            Posterior { jm: vec![1.0], distance_mm: vec![15.0], weights: vec![1.0], misfit: 0.0 };
        let none = RecordError {
            force_part: 0.0,
            force_n: 0.0,
            thickness_mm: 0.0,
            model_part: 0.0,
            bent_part: 0.0,
        };
        let found = foretell(&left, &posterior, &none, &[60.0, 40.0]);
        assert_eq!(found.len(), 1);
        let exact = force(86.0, 1.0, 15.0, 60.0);
        assert!(found[0].force_n.iter().all(|n| (n / exact - 1.0).abs() < 1e-9), "{found:?}");
        assert!(foretold_table(&found).starts_with("thickness_mm,force_p05_n"));
        let record = Measured { thickness_mm: 60.0, force_n: exact };
        let said = foretold_said("left", found.first(), record);
        assert!(said.contains("which holds"), "{said}");
        let said = foretold_said("left", found.first(), Measured { force_n: 99.0, ..record });
        assert!(said.contains("does not hold"), "{said}");
        assert!(foretold_said("left", None, record).contains("not reached"));
    }
}
