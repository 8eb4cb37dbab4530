//! What can be fitted: numbers of the tissues, by their keys in the study.

use crate::model::Moduli;
use mammotwin_data::{labels::Side, study::ModelPlan};

/// A number of the tissues. The breasts come first: each moves its own skin alone, the others move both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parameter {
    /// Young's modulus of the right breast.
    Right,
    /// Young's modulus of the left breast.
    Left,
    /// Young's modulus of the skin.
    Skin,
    /// Young's modulus of the deep fascia.
    Fascia,
    /// Young's modulus of the suspensory ligaments.
    Ligaments,
    /// Jₘ of the breasts.
    BreastJm,
    /// Jₘ of the skin.
    SkinJm,
    /// Jₘ of the deep fascia.
    FasciaJm,
}

impl Parameter {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Right,
        Self::Left,
        Self::Skin,
        Self::Fascia,
        Self::Ligaments,
        Self::BreastJm,
        Self::SkinJm,
        Self::FasciaJm,
    ];

    /// Of a breast.
    pub fn of_side(side: Side) -> Self {
        match side {
            Side::Right => Self::Right,
            Side::Left => Self::Left,
        }
    }

    /// What both breasts share.
    pub fn shared() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|parameter| parameter.side().is_none())
    }

    /// Those that a study names, in the order of [`Parameter::ALL`].
    pub fn named(keys: &[String]) -> Vec<Self> {
        Self::ALL.into_iter().filter(|known| keys.iter().any(|key| key == known.key())).collect()
    }

    /// Key in `calibrate.parameters`.
    pub fn key(self) -> &'static str {
        match self {
            Self::Right => "breast.young_right_kpa",
            Self::Left => "breast.young_left_kpa",
            Self::Skin => "skin.young_kpa",
            Self::Fascia => "fascia.young_kpa",
            Self::Ligaments => "ligaments.young_kpa",
            Self::BreastJm => "breast.jm",
            Self::SkinJm => "skin.jm",
            Self::FasciaJm => "fascia.jm",
        }
    }

    /// What it is, in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Right => "right breast",
            Self::Left => "left breast",
            Self::Skin => "skin",
            Self::Fascia => "fascia",
            Self::Ligaments => "ligaments",
            Self::BreastJm => "Jₘ of the breasts",
            Self::SkinJm => "Jₘ of the skin",
            Self::FasciaJm => "Jₘ of the fascia",
        }
    }

    /// The same as the beginning of a line.
    pub fn title(self) -> String {
        let mut letters = self.words().chars();
        letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
    }

    /// `kPa`, or `1`.
    pub fn units(self) -> &'static str {
        if self.is_jm() { "1" } else { "kPa" }
    }

    /// A value with its units.
    pub fn written(self, value: f64) -> String {
        let units = if self.is_jm() { "" } else { " kPa" };
        format!("{value:.3}{units}")
    }

    /// Whether a search could not go on from this value, up or down.
    pub fn is_bound(self, value: f64) -> bool {
        let [low, high] = self.bounds();
        value <= low * (1.0 + 1e-9) || value >= high * (1.0 - 1e-9)
    }

    /// The breast whose skin it moves; `None` for both.
    pub fn side(self) -> Option<Side> {
        match self {
            Self::Right => Some(Side::Right),
            Self::Left => Some(Side::Left),
            _ => None,
        }
    }

    fn is_jm(self) -> bool {
        matches!(self, Self::BreastJm | Self::SkinJm | Self::FasciaJm)
    }

    /// Values between which a search stays (kPa, or 1). A larger Jₘ than the last is none, as far as a pose tells.
    pub(super) fn bounds(self) -> [f64; 2] {
        match self {
            Self::Right | Self::Left => [0.05, 20.0],
            Self::Skin => [0.5, 200.0],
            Self::Fascia => [5.0, 5000.0],
            Self::Ligaments => [10.0, 1e4],
            Self::BreastJm | Self::SkinJm | Self::FasciaJm => [0.2, 100.0],
        }
    }

    /// Its value (kPa, or 1) in these moduli; `None` where they leave it to the plan.
    pub fn given(self, moduli: &Moduli) -> Option<f64> {
        let shared = &moduli.shared;
        match self {
            Self::Right => Some(moduli.right_kpa),
            Self::Left => Some(moduli.left_kpa),
            Self::Skin => shared.skin_kpa,
            Self::Fascia => shared.fascia_kpa,
            Self::Ligaments => shared.ligaments_kpa,
            Self::BreastJm => shared.breast_jm,
            Self::SkinJm => shared.skin_jm,
            Self::FasciaJm => shared.fascia_jm,
        }
    }

    /// The same, else that of the plan. `None` for a Jₘ of a law without one.
    pub fn value(self, moduli: &Moduli, plan: &ModelPlan) -> Option<f64> {
        self.given(moduli).or(match self {
            Self::Right => Some(plan.breast.young_right_kpa),
            Self::Left => Some(plan.breast.young_left_kpa),
            Self::Skin => Some(plan.skin.young_kpa),
            Self::Fascia => Some(plan.fascia.young_kpa),
            Self::Ligaments => Some(plan.ligaments.young_kpa),
            Self::BreastJm => plan.breast.jm,
            Self::SkinJm => plan.skin.jm,
            Self::FasciaJm => plan.fascia.jm,
        })
    }

    /// Multiplies a fitted number; one that was not fitted stays.
    pub(super) fn scale(self, moduli: &mut Moduli, by: f64) {
        if let Some(value) = self.given(moduli) {
            self.set(moduli, by * value);
        }
    }

    /// Sets it (kPa, or 1).
    pub fn set(self, moduli: &mut Moduli, value: f64) {
        let shared = &mut moduli.shared;
        match self {
            Self::Right => moduli.right_kpa = value,
            Self::Left => moduli.left_kpa = value,
            Self::Skin => shared.skin_kpa = Some(value),
            Self::Fascia => shared.fascia_kpa = Some(value),
            Self::Ligaments => shared.ligaments_kpa = Some(value),
            Self::BreastJm => shared.breast_jm = Some(value),
            Self::SkinJm => shared.skin_jm = Some(value),
            Self::FasciaJm => shared.fascia_jm = Some(value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::study::CALIBRATED;

    #[test]
    fn keys_are_those_that_a_study_may_name() {
        assert_eq!(Parameter::ALL.map(Parameter::key), CALIBRATED);
    }

    #[test]
    fn values_are_written_with_their_units_and_bounds_are_told() {
        assert_eq!(Parameter::Skin.written(4.19304), "4.193 kPa");
        assert_eq!(Parameter::BreastJm.written(2.0), "2.000");
        assert_eq!(Parameter::SkinJm.title(), "Jₘ of the skin");
        assert!(Parameter::Skin.is_bound(0.5_f64.ln().exp()) && !Parameter::Skin.is_bound(0.51));
    }

    #[test]
    fn what_is_set_is_what_the_plan_has_then() {
        let plan = ModelPlan::default();
        for (n, parameter) in Parameter::ALL.into_iter().enumerate() {
            let mut moduli = Moduli::of(&plan);
            let before = Parameter::ALL.map(|other| other.value(&moduli, &plan));
            parameter.set(&mut moduli, 7.5);
            let after = Parameter::ALL.map(|other| other.value(&moduli, &plan));
            for k in 0..after.len() {
                assert_eq!(after[k], if k == n { Some(7.5) } else { before[k] }, "{parameter:?}");
            }
            let applied = moduli.applied(&plan);
            assert_eq!(parameter.value(&Moduli::of(&applied), &applied), Some(7.5));
        }
    }
}
