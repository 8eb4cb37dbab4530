//! Designs of paddles beside each other, over persons and positions: what each costs and gives, and
//! which ones nothing beats in everything.

mod page;
mod paired;
mod pareto;
mod table;

pub use page::page;
pub use paired::{COMPARED, Compared, Pair, Ratio, pairs};
pub use pareto::front;
pub use table::{designs_csv, summary_csv};

use crate::{comparison::Found, page::median};
use mammotwin_data::study::{CompressPlan, StopPlan};
use mammotwin_stages::in_view::InView;

/// Whether little or much of a quantity is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// Little.
    Least,
    /// Much.
    Most,
}

/// A quantity by which designs are judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Objective {
    /// Machine name with its unit.
    pub name: &'static str,
    /// In words, with the unit.
    pub words: &'static str,
    /// What is wanted of it.
    pub wanted: Wanted,
}

/// Of the paddle's face: the receptor, which is alike for all, and fronts can bear more and would hide what a paddle
/// does.
const PRESSURE: Objective = Objective {
    name: "paddle_peak_pressure_kpa",
    words: "largest pressure, paddle's face (kPa)",
    wanted: Wanted::Least,
};
const THICKNESS: Objective = Objective {
    name: "nominal_thickness_mm",
    words: "compressed thickness (mm)",
    wanted: Wanted::Least,
};
const FORCE: Objective = Objective { name: "force_n", words: "force (N)", wanted: Wanted::Least };
const DOSE: Objective =
    Objective { name: "agd_mgy", words: "glandular dose (mGy)", wanted: Wanted::Least };
/// Name of the share of the breast in view.
const IN_VIEW: &str = "in_view_share";
const TISSUE: Objective =
    Objective { name: IN_VIEW, words: "breast in view (share)", wanted: Wanted::Most };

/// What is judged: pressure, thickness at the given limit or, where a thickness is given, force, dose where there is
/// a picture, tissue in view.
pub fn objectives(stop: &StopPlan, pictured: bool) -> Vec<Objective> {
    let only_thickness =
        StopPlan { thickness_mm: stop.thickness_mm, ..StopPlan::default() } == *stop;
    let mut all = vec![PRESSURE, if only_thickness { FORCE } else { THICKNESS }];
    all.extend(pictured.then_some(DOSE));
    all.push(TISSUE);
    all
}

/// A design at a position.
#[derive(Debug, Clone)]
pub struct Way {
    /// Its name: `flex`, `flex_15mm`.
    pub label: String,
    /// The design.
    pub design: String,
    /// How it compresses.
    pub plan: CompressPlan,
}

/// One way on one person.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Distance (mm) from her chest wall to the paddle's edge.
    pub chest_wall_distance_mm: f64,
    /// The objectives' values; NaN where one was not found.
    pub values: Vec<f64>,
    /// What pairs of paddles are compared by, in the order of [`COMPARED`]; NaN where one was not found.
    pub compared: Vec<f64>,
    /// One standard deviation of each of these; NaN where there is none.
    pub deviations: Vec<f64>,
    /// What they rest on, or why there are none, where the study asks for them.
    pub deviations_of: Option<String>,
    /// Force (N).
    pub force_n: f64,
    /// Nominal thickness (mm).
    pub thickness_mm: f64,
    /// Volume in view (cm³).
    pub in_view_cm3: f64,
    /// The key of `compress.stop` that ended it.
    pub ended_by: Option<String>,
    /// Why it does not count: it failed, or ended before its stop rule.
    pub why_not: Option<String>,
}

impl Trial {
    /// What was found of one way.
    pub fn of(way: &Way, found: &Found, view: Option<InView>, objectives: &[Objective]) -> Self {
        let share = view.map_or(f64::NAN, |view| view.share);
        let value = |one: &Objective| match one.name {
            IN_VIEW => share,
            name => found.metric(name),
        };
        let met = found.compression.met.clone();
        let early = found.compression.stopped_early.clone();
        let missed = || met.is_none().then(|| "reached no limit of its stop rule".to_owned());
        Self {
            chest_wall_distance_mm: way.plan.chest_wall_distance_mm,
            values: objectives.iter().map(value).collect(),
            compared: COMPARED.iter().map(|one| found.metric(one.name)).collect(),
            deviations: COMPARED.iter().map(|one| found.sd(one.name)).collect(),
            deviations_of: found.deviations.clone(),
            force_n: found.metric("force_n"),
            thickness_mm: found.metric("nominal_thickness_mm"),
            in_view_cm3: view.map_or(f64::NAN, |view| view.volume_cm3),
            why_not: early.or_else(missed),
            ended_by: met,
        }
    }

    /// A way that could not be gone.
    pub fn failed(way: &Way, why: String, objectives: &[Objective]) -> Self {
        Self {
            chest_wall_distance_mm: way.plan.chest_wall_distance_mm,
            values: vec![f64::NAN; objectives.len()],
            compared: vec![f64::NAN; COMPARED.len()],
            deviations: vec![f64::NAN; COMPARED.len()],
            deviations_of: None,
            force_n: f64::NAN,
            thickness_mm: f64::NAN,
            in_view_cm3: f64::NAN,
            ended_by: None,
            why_not: Some(why),
        }
    }

    /// One standard deviation of a metric; NaN where there is none.
    pub fn sd(&self, name: &str) -> f64 {
        let place = COMPARED.iter().position(|one| one.name == name);
        place.and_then(|n| self.deviations.get(n)).copied().unwrap_or(f64::NAN)
    }

    /// Values of which small ones are wanted; NaN of what does not count.
    fn costs(&self, objectives: &[Objective]) -> Vec<f64> {
        let cost = |(value, objective): (&f64, &Objective)| match (&self.why_not, objective.wanted)
        {
            (Some(_), _) => f64::NAN,
            (None, Wanted::Least) => *value,
            (None, Wanted::Most) => -value,
        };
        self.values.iter().zip(objectives).map(cost).collect()
    }
}

/// All ways on one person.
#[derive(Debug, Clone)]
pub struct Person {
    /// Her pseudonym.
    pub id: String,
    /// Edge (mm) of the elements of her mesh.
    pub mesh_mm: f64,
    /// In the order of the ways.
    pub trials: Vec<Trial>,
    /// Which of them lie on her front.
    pub on_front: Vec<bool>,
}

impl Person {
    /// With her front.
    pub fn of(id: String, mesh_mm: f64, trials: Vec<Trial>, objectives: &[Objective]) -> Self {
        let costs: Vec<Vec<f64>> = trials.iter().map(|trial| trial.costs(objectives)).collect();
        Self { id, mesh_mm, on_front: front(&costs), trials }
    }
}

/// One way over all persons.
#[derive(Debug, Clone)]
pub struct Overall {
    /// Median over the persons of each objective over that of the first way; NaN where a person lacks it.
    pub over_first: Vec<f64>,
    /// Whether it lies on the front of these medians.
    pub on_front: bool,
    /// On how many persons' fronts it lies.
    pub fronts: usize,
    /// Persons on whom it counts.
    pub persons: usize,
}

/// All ways over all persons. Persons differ more than paddles do, so each person's values are taken over those of the
/// first way on her; a way that does not count on every person has no median, and nor has any when the first does not.
pub fn overall(ways: usize, persons: &[Person], objectives: &[Objective]) -> Vec<Overall> {
    let ratio = |way: usize, n: usize| {
        let ratios: Vec<f64> = persons
            .iter()
            .map(|person| {
                let [one, first] = [way, 0].map(|at| &person.trials[at]);
                let counts = one.why_not.is_none() && first.why_not.is_none();
                if counts { one.values[n] / first.values[n] } else { f64::NAN }
            })
            .collect();
        if ratios.iter().all(|ratio| ratio.is_finite()) { median(ratios) } else { None }
    };
    let medians: Vec<Vec<f64>> = (0..ways)
        .map(|way| (0..objectives.len()).map(|n| ratio(way, n).unwrap_or(f64::NAN)).collect())
        .collect();
    let cost = |(value, objective): (&f64, &Objective)| match objective.wanted {
        Wanted::Least => *value,
        Wanted::Most => -value,
    };
    let costs: Vec<Vec<f64>> =
        medians.iter().map(|values| values.iter().zip(objectives).map(cost).collect()).collect();
    let on_front = front(&costs);
    let counted = |way: usize| persons.iter().filter(|p| p.trials[way].why_not.is_none()).count();
    let best = |way: usize| persons.iter().filter(|person| person.on_front[way]).count();
    let one = |(way, over_first): (usize, Vec<f64>)| Overall {
        over_first,
        on_front: on_front[way],
        fronts: best(way),
        persons: counted(way),
    };
    medians.into_iter().enumerate().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn person(trials: &[(f64, f64, Option<&str>)], objectives: &[Objective]) -> Person {
        let trial = |&(pressure, view, why): &(f64, f64, Option<&str>)| Trial {
            chest_wall_distance_mm: 15.0,
            values: vec![pressure, view],
            compared: vec![pressure; COMPARED.len()],
            deviations: vec![0.1 * pressure; COMPARED.len()],
            deviations_of: Some("fitted moduli (10.0 %)".into()),
            force_n: f64::NAN,
            thickness_mm: f64::NAN,
            in_view_cm3: f64::NAN,
            ended_by: None,
            why_not: why.map(String::from),
        };
        Person::of("a".into(), 15.0, trials.iter().map(trial).collect(), objectives)
    }

    #[test]
    fn fronts_want_little_pressure_and_much_tissue_of_what_counts() {
        let wanted = [PRESSURE, TISSUE];
        let early = Some("ended early");
        let found = [(10.0, 0.6, None), (8.0, 0.5, None), (11.0, 0.5, None), (1.0, 0.9, early)];
        let a = person(&found, &wanted);
        assert_eq!(a.on_front, [true, true, false, false]);
        // Twice the pressures, otherwise alike: the medians of the ratios are those of one.
        let b = person(&found.map(|(p, view, why)| (2.0 * p, view, why)), &wanted);
        let all = overall(4, &[a, b], &wanted);
        assert!((all[1].over_first[0] - 0.8).abs() < 1e-12);
        assert_eq!(
            all.iter().map(|one| one.on_front).collect::<Vec<_>>(),
            [true, true, false, false]
        );
        assert_eq!((all[0].fronts, all[2].fronts, all[3].persons), (2, 0, 0));
        assert!(all[3].over_first[0].is_nan());
    }

    /// Deviations stand in the table and on the page, for whom they are known.
    #[test]
    fn deviations_are_told() {
        let wanted = [PRESSURE, TISSUE];
        let mut her = person(&[(10.0, 0.6, None), (8.0, 0.5, None)], &wanted);
        her.trials[1].deviations = vec![f64::NAN; COMPARED.len()];
        let way = |label: &str| Way {
            label: label.into(),
            design: label.into(),
            plan: table::tests::plan(),
        };
        let ways = [way("rigid"), way("flex")];
        let persons = [her];
        let csv = designs_csv(&ways, &persons, &wanted);
        let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
        assert!(rows.iter().all(|row| row.len() == rows[0].len()), "{csv}");
        for name in ["paddle_peak_pressure_kpa_sd", "paddle_pressure_p95_kpa_sd", "force_n_sd"] {
            let at = rows[0].iter().position(|cell| *cell == name).unwrap();
            assert_eq!([rows[1][at], rows[2][at]], ["1.000000", ""], "{name}");
        }
        let all = overall(2, &persons, &wanted);
        let (html, _) = page(&ways, &persons, &all, &[], &wanted);
        assert!(html.contains("10.0 ± 1.00") && html.contains("8.00<"), "{html}");
        assert!(html.contains("rigid, flex: fitted moduli (10.0 %)"));
    }

    /// Pairs are of one distance, and of persons on whom both count.
    #[test]
    fn pairs_are_of_one_distance_and_of_persons_with_both() {
        let plan = |mm: f64| CompressPlan { chest_wall_distance_mm: mm, ..table::tests::plan() };
        let way = |design: &str, mm: f64| Way {
            label: format!("{design}_{mm}mm"),
            design: design.into(),
            plan: plan(mm),
        };
        let ways = [way("rigid", 15.0), way("rigid", 20.0), way("flex", 15.0), way("flex", 20.0)];
        let early = Some("ended early");
        let found = |c, why| [(10.0, 0.5, None), (4.0, 0.5, None), (8.0, 0.5, why), (c, 0.5, None)];
        let wanted = [PRESSURE, TISSUE];
        let persons = [person(&found(5.0, None), &wanted), person(&found(3.2, early), &wanted)];
        let all = pairs(&ways, &persons);
        assert_eq!(all.iter().map(|p| (p.way, p.against)).collect::<Vec<_>>(), [(2, 0), (3, 1)]);
        let [near, far] = [&all[0], &all[1]].map(|pair| pair.ratios[0].unwrap());
        assert!((near.mean - 0.8).abs() < 1e-12 && near.persons == 1 && near.interval.is_none());
        // 1.25 and 0.8: one up, one down.
        assert!((far.mean - 1.0).abs() < 1e-12 && (far.persons, far.lower) == (2, 1));
    }

    #[test]
    fn what_is_judged_depends_on_what_is_given() {
        let force = StopPlan { force_n: Some(20.0), ..StopPlan::default() };
        let thickness = StopPlan { thickness_mm: Some(46.0), ..StopPlan::default() };
        let both = StopPlan { thickness_mm: Some(46.0), ..force };
        assert_eq!(objectives(&force, true)[1], THICKNESS);
        assert_eq!(objectives(&both, true)[1], THICKNESS);
        assert_eq!(objectives(&thickness, true)[1], FORCE);
        assert_eq!(objectives(&thickness, false).len(), 3);
    }
}
