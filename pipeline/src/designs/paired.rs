//! Each paddle against the first one on the same persons: persons differ more than paddles do.

use super::{Person, Way};
use mammotwin_imaging::xray::statistics::student;

/// A metric by which paddles are compared in pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Compared {
    /// Machine name with its unit.
    pub name: &'static str,
    /// In words.
    pub words: &'static str,
}

const fn compared(name: &'static str, words: &'static str) -> Compared {
    Compared { name, words }
}

/// What is compared. Of force and thickness one is what all are pressed to.
pub const COMPARED: [Compared; 9] = [
    compared("paddle_peak_pressure_kpa", "largest pressure, paddle's face"),
    compared("paddle_pressure_p95_kpa", "pressure, 95 % of the paddle's face"),
    compared("face_peak_pressure_kpa", "largest pressure, faces of both plates"),
    compared("peak_pressure_kpa", "largest pressure, fronts and edges too"),
    compared("mean_pressure_kpa", "mean pressure of the paddle's face"),
    compared("force_n", "force"),
    compared("nominal_thickness_mm", "nominal thickness"),
    compared("von_mises_p95_kpa", "von Mises stress, 95 % of the volume"),
    compared("agd_mgy", "glandular dose"),
];

/// A share of chance that the interval of a ratio is to hold.
const INSIDE: f64 = 0.95;

/// Ratios of a metric on several persons.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratio {
    /// Their geometric mean.
    pub mean: f64,
    /// 95 % interval of that mean: Student's t of ln ratio; `None` of fewer than two persons.
    pub interval: Option<[f64; 2]>,
    /// Persons on whom both paddles count.
    pub persons: usize,
    /// On how many of them the ratio is below one.
    pub lower: usize,
}

impl Ratio {
    /// Of the ratios that are numbers above zero; `None` without any.
    pub fn of(ratios: impl IntoIterator<Item = f64>) -> Option<Self> {
        let good = |ratio: &f64| ratio.is_finite() && *ratio > 0.0;
        let logs: Vec<f64> = ratios.into_iter().filter(good).map(f64::ln).collect();
        let persons = logs.len();
        if persons == 0 {
            return None;
        }
        let count = persons as f64;
        let mean = logs.iter().sum::<f64>() / count;
        let squares: f64 = logs.iter().map(|log| (log - mean).powi(2)).sum();
        let interval = (persons > 1).then(|| {
            let error = (squares / (count - 1.0) / count).sqrt();
            let half = student(INSIDE, count - 1.0) * error;
            [(mean - half).exp(), (mean + half).exp()]
        });
        let lower = logs.iter().filter(|log| **log < 0.0).count();
        Some(Self { mean: mean.exp(), interval, persons, lower })
    }

    /// Whether the interval holds no one: lower or higher beyond the spread of the persons.
    pub fn is_clear(&self) -> bool {
        self.interval.is_some_and(|[low, high]| high < 1.0 || low > 1.0)
    }
}

/// One way against the first design at the same distance from the chest wall.
#[derive(Debug, Clone)]
pub struct Pair {
    /// Which way.
    pub way: usize,
    /// Which one it is compared with.
    pub against: usize,
    /// In the order of [`COMPARED`].
    pub ratios: Vec<Option<Ratio>>,
}

/// Every way but those that are the first of their distance. A person on whom one of both does not count is left
/// out of a pair.
pub fn pairs(ways: &[Way], persons: &[Person]) -> Vec<Pair> {
    let mut all = Vec::new();
    for (way, one) in ways.iter().enumerate() {
        let near =
            |other: &Way| other.plan.chest_wall_distance_mm == one.plan.chest_wall_distance_mm;
        let Some(against) = ways[..way].iter().position(near) else { continue };
        let ratios = (0..COMPARED.len()).map(|n| {
            Ratio::of(persons.iter().map(|person| {
                let [one, first] = [way, against].map(|at| &person.trials[at]);
                let counts = one.why_not.is_none() && first.why_not.is_none();
                if counts { one.compared[n] / first.compared[n] } else { f64::NAN }
            }))
        });
        all.push(Pair { way, against, ratios: ratios.collect() });
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ratios 0.5, 0.8, 1: mean 0.4^(1/3); ln has a standard deviation of 0.35382, t of two degrees is 4.30265.
    #[test]
    fn the_interval_of_three_ratios_is_that_computed_by_hand() {
        let ratio = Ratio::of([0.5, 0.8, 1.0, f64::NAN, 0.0]).unwrap();
        assert!((ratio.mean - 0.736_806_299_728).abs() < 1e-11);
        let [low, high] = ratio.interval.unwrap();
        assert!((low - 0.305_936_311_504).abs() < 1e-10, "{low}");
        assert!((high - 1.774_498_491_697).abs() < 1e-9, "{high}");
        assert_eq!((ratio.persons, ratio.lower, ratio.is_clear()), (3, 2, false));
    }

    #[test]
    fn one_person_has_a_ratio_and_no_interval() {
        let one = Ratio::of([0.8]).unwrap();
        assert!((one.mean - 0.8).abs() < 1e-15 && one.interval.is_none() && !one.is_clear());
        assert_eq!(Ratio::of([f64::NAN]), None);
        // Persons who agree: no width, and clear.
        let alike = Ratio::of([0.8; 4]).unwrap();
        assert!(alike.is_clear() && (alike.interval.unwrap()[0] - 0.8).abs() < 1e-12);
    }

    /// The inverse of a ratio has the inverse interval: no paddle is favoured by being the first.
    #[test]
    fn either_paddle_may_be_the_first() {
        let ratios = [0.7, 1.1, 0.9, 0.95, 0.6];
        let [a, b] = [Ratio::of(ratios), Ratio::of(ratios.map(|r| 1.0 / r))].map(Option::unwrap);
        let [one, two] = [a, b].map(|ratio| ratio.interval.unwrap());
        assert!((a.mean * b.mean - 1.0).abs() < 1e-12);
        assert!((one[0] * two[1] - 1.0).abs() < 1e-12 && (one[1] * two[0] - 1.0).abs() < 1e-12);
        assert_eq!((a.lower, b.lower), (4, 1));
    }
}
