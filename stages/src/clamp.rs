//! Clamping and release: the force of the plates in time.

use crate::{compress::Compression, quality::Metrics};
use mammotwin_data::{
    Failure,
    metric::Metric,
    progress::Progress,
    store::Stage,
    study::{ClampPlan, HeldName, MeasuredIn},
    units::NEWTON,
};
use mammotwin_solver::viscoelastic::{
    Decay, ElasticCurve, Held, MonotoneCubic, Phases, Relaxation, TimeCourse, course,
};
use serde::{Deserialize, Serialize};

/// Follows a compression in time: closing, clamping, opening.
#[derive(Debug, Clone, Serialize)]
pub struct Clamp {
    /// Durations, what is held, how the tissue relaxes.
    pub plan: ClampPlan,
}

/// A compression in time; all columns have one length.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ClampCourse {
    /// Time since the first touch (s).
    pub time_s: Vec<f64>,
    /// Distance of the plates (mm).
    pub thickness_mm: Vec<f64>,
    /// Thickness of the breast (mm): that of the plates until they leave it.
    pub breast_mm: Vec<f64>,
    /// Force of the paddle (N).
    pub force_n: Vec<f64>,
    /// Force that it would come to at this thickness (N): that of the compression.
    pub elastic_force_n: Vec<f64>,
    /// Force over the contact area that the compression had at this thickness (kPa).
    pub mean_pressure_kpa: Vec<f64>,
    /// Indices at which clamping begins and ends.
    pub clamp: [usize; 2],
}

/// The relaxation function of a plan.
fn relaxation(plan: &ClampPlan) -> Relaxation {
    let terms = plan.times_s.iter().zip(&plan.shares);
    let decays: Vec<Decay> = terms.map(|(&time_s, &share)| Decay { share, time_s }).collect();
    match plan.measured_in {
        MeasuredIn::Creep => Relaxation::of_creep(&decays),
        MeasuredIn::Relaxation => Relaxation { decays },
    }
}

impl ClampCourse {
    /// Columns of a course, with contact areas (mm²) by thickness (mm).
    fn of(made: &TimeCourse, area_mm2: &dyn Fn(f64) -> f64) -> Self {
        let mut course = Self { clamp: made.clamp, ..Self::default() };
        for now in &made.instants {
            let area = area_mm2(now.breast_mm);
            course.time_s.push(now.time_s);
            course.thickness_mm.push(now.plates_mm);
            course.breast_mm.push(now.breast_mm);
            course.force_n.push(now.force_mn / NEWTON);
            course.elastic_force_n.push(now.elastic_mn / NEWTON);
            course.mean_pressure_kpa.push(if area > 0.0 { now.force_mn / area } else { 0.0 });
        }
        course
    }
}

impl Stage for Clamp {
    const NAME: &'static str = "clamp";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "Clamping and release are quasi-linear viscoelastic (Fung): the force-thickness curve of the \
         compression is the long-term one and is convolved in time with one reduced relaxation function for all tissues, \
         from the creep of breast in vivo unless the study gives another (Sridhar and Insana, Med. Phys. 34 (2007) 4757); \
         durations after de Groot et al. (BMC Womens Health 15 (2015) 26).";
    type Input = Compression;
    type Output = Metrics;

    fn run(&self, compression: &Compression, _: &dyn Progress) -> Result<Metrics, Failure> {
        let curve = &compression.curve;
        let force_mn: Vec<f64> = curve.force_n.iter().map(|force| force * NEWTON).collect();
        let Some(elastic) = ElasticCurve::through(&curve.thickness_mm, &force_mn) else {
            // A compression of one state has no course; the report says why it ended.
            return Ok(Metrics::default());
        };
        let start_mm = elastic.ends_mm()[0];
        let ways = curve.thickness_mm.iter().map(|thickness| start_mm - thickness);
        let areas = MonotoneCubic::through(ways.zip(curve.contact_area_mm2.iter().copied()));
        let area_mm2 = |thickness: f64| areas.as_ref().map_or(0.0, |a| a.at(start_mm - thickness));
        let phases = Phases {
            ramp_s: self.plan.ramp_s,
            clamp_s: self.plan.clamp_s,
            release_s: self.plan.release_s,
            held: match self.plan.held {
                HeldName::Thickness => Held::Thickness,
                HeldName::Force => Held::Force,
            },
        };
        let relaxation = relaxation(&self.plan);
        let made = course(&elastic, &relaxation, &phases);
        let course = ClampCourse::of(&made, &area_mm2);
        let metrics = self.metrics(&course, &made, &relaxation);
        Ok(Metrics { metrics, course: Some(course), ..Metrics::default() })
    }
}

impl Clamp {
    fn metrics(
        &self,
        course: &ClampCourse,
        made: &TimeCourse,
        relaxation: &Relaxation,
    ) -> Vec<Metric> {
        let [begin, end] = course.clamp;
        let source = "quasi-linear viscoelasticity, docs/theory.md";
        let mut metrics = Vec::new();
        let mut add = |name: &str, long: &str, unit: &str, value: f64| {
            metrics.push(Metric::new(name, long, unit, value, source));
        };
        let force = &course.force_n;
        add("clamp_force_start_n", "force when clamping begins", "N", force[begin]);
        add("clamp_force_end_n", "force when clamping ends", "N", force[end]);
        let eased = if force[begin] > 0.0 { 1.0 - force[end] / force[begin] } else { 0.0 };
        let long = "share of the force that relaxes while clamped";
        add("clamp_relaxation_share", long, "", eased);
        let long = "force after endless clamping at the last thickness";
        add("clamp_elastic_force_n", long, "N", course.elastic_force_n[end]);
        let pressure = &course.mean_pressure_kpa;
        let long = "mean pressure when clamping begins";
        add("clamp_mean_pressure_start_kpa", long, "kPa", pressure[begin]);
        let long = "mean pressure when clamping ends";
        add("clamp_mean_pressure_end_kpa", long, "kPa", pressure[end]);
        let thickness = &course.thickness_mm;
        add("clamp_thickness_start_mm", "thickness when clamping begins", "mm", thickness[begin]);
        add("clamp_thickness_end_mm", "thickness when clamping ends", "mm", thickness[end]);
        // µJ is mN mm.
        let [done, back] = made.work_uj().map(|work| work / NEWTON);
        add("clamp_work_mj", "work of the plates on the breast", "mJ", done);
        let long = "work that the breast has not given back at the end of the release";
        add("clamp_energy_lost_mj", long, "mJ", done - back);
        let lost = if done > 0.0 { 1.0 - back / done } else { 0.0 };
        add("clamp_energy_lost_share", "the same, over the work of the plates", "", lost);
        let long = "force of a step at once, over that of endless clamping";
        add("clamp_instant_stiffness", long, "", relaxation.at(0.0));
        if let Some(free) = made.lift_off_s() {
            let after = free - course.time_s[end];
            let long = "time from the start of the release until the paddle leaves the breast";
            add("clamp_lift_off_s", long, "s", after);
        }
        metrics
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compress::Course;
    use mammotwin_data::progress::Silent;

    /// A compression of which only the course counts.
    fn compressed(thickness_mm: Vec<f64>, force_n: Vec<f64>) -> Compression {
        let contact_area_mm2 = force_n.iter().map(|_| 5000.0).collect();
        Compression::of_course(Course {
            thickness_mm,
            force_n,
            contact_area_mm2,
            ..Course::default()
        })
    }

    fn run(plan: ClampPlan) -> Metrics {
        let breast = compressed(vec![80.0, 65.0, 50.0], vec![0.0, 30.0, 60.0]);
        Clamp { plan }.run(&breast, &Silent).unwrap()
    }

    fn value(of: &Metrics, name: &str) -> f64 {
        of.metrics.iter().find(|m| m.name == name).map(|m| m.value).expect(name)
    }

    #[test]
    fn forces_of_the_default_are_those_of_its_spectrum() {
        let found = run(ClampPlan::default());
        // Creep of 3.2 and 42 s with half a strain each relaxes with these times and shares.
        let rates = |root: f64| (33.9 + root * (33.9f64.powi(2) - 4.0 * 67.2).sqrt()) / 134.4;
        let force = |time: f64| {
            let part = |rate: f64, share: f64| {
                let (closing, after) = (7.5, time - 7.5);
                60.0 / closing * share / rate
                    * (1.0 - f64::exp(-rate * closing))
                    * f64::exp(-rate * after)
            };
            60.0 + part(rates(1.0), 0.690_417) + part(rates(-1.0), 0.309_583)
        };
        assert!((value(&found, "clamp_force_start_n") / force(7.5) - 1.0).abs() < 1e-6);
        assert!((value(&found, "clamp_force_end_n") / force(20.3) - 1.0).abs() < 1e-6);
        assert!((value(&found, "clamp_instant_stiffness") - 2.0).abs() < 1e-12);
        assert!((value(&found, "clamp_elastic_force_n") - 60.0).abs() < 1e-12);
        let course = found.course.unwrap();
        let mean = course.force_n[course.clamp[0]] * NEWTON / 5000.0;
        assert!((course.mean_pressure_kpa[course.clamp[0]] - mean).abs() < 1e-12);
        assert!((course.time_s.last().unwrap() - 22.3).abs() < 1e-12);
    }

    #[test]
    fn without_shares_nothing_relaxes_and_nothing_is_lost() {
        let found = run(ClampPlan { shares: vec![0.0, 0.0], ..ClampPlan::default() });
        assert_eq!(value(&found, "clamp_relaxation_share"), 0.0);
        assert!(value(&found, "clamp_energy_lost_share").abs() < 1e-12);
    }

    #[test]
    fn a_held_force_is_that_of_the_compression() {
        let found = run(ClampPlan { held: HeldName::Force, ..ClampPlan::default() });
        for name in ["clamp_force_start_n", "clamp_force_end_n"] {
            assert!((value(&found, name) - 60.0).abs() < 1e-9);
        }
        let [start, end] =
            ["clamp_thickness_start_mm", "clamp_thickness_end_mm"].map(|name| value(&found, name));
        assert!(start > end && end > 50.0, "{start} {end}");
    }

    #[test]
    fn a_compression_of_one_state_has_no_course() {
        let breast = compressed(vec![80.0], vec![0.0]);
        let found = Clamp { plan: ClampPlan::default() }.run(&breast, &Silent).unwrap();
        assert_eq!(found, Metrics::default());
    }
}
