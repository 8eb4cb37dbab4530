//! The numbers of the tissues that a calibration may change.

use mammotwin_data::{labels::Side, study::ModelPlan};
use serde::{Deserialize, Serialize};

/// Young's moduli of the breasts, and what else is fitted: the unknowns of the calibration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Moduli {
    /// Right breast (kPa).
    pub right_kpa: f64,
    /// Left breast (kPa).
    pub left_kpa: f64,
    /// What both sides share.
    #[serde(default)]
    pub shared: Shared,
}

/// Numbers of both sides that stand in place of those of the plan; none where it is not fitted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Shared {
    /// Young's modulus of the skin (kPa).
    pub skin_kpa: Option<f64>,
    /// Of the deep fascia (kPa).
    pub fascia_kpa: Option<f64>,
    /// Of the suspensory ligaments (kPa).
    pub ligaments_kpa: Option<f64>,
    /// Jₘ of the breasts.
    pub breast_jm: Option<f64>,
    /// Jₘ of the skin.
    pub skin_jm: Option<f64>,
    /// Jₘ of the deep fascia.
    pub fascia_jm: Option<f64>,
}

impl Moduli {
    /// Of the breasts alone (kPa).
    pub const fn new(right_kpa: f64, left_kpa: f64) -> Self {
        let (skin_kpa, fascia_kpa, ligaments_kpa) = (None, None, None);
        let (breast_jm, skin_jm, fascia_jm) = (None, None, None);
        let shared = Shared { skin_kpa, fascia_kpa, ligaments_kpa, breast_jm, skin_jm, fascia_jm };
        Self { right_kpa, left_kpa, shared }
    }

    /// The moduli that a study gives.
    pub fn of(plan: &ModelPlan) -> Self {
        Self::new(plan.breast.young_right_kpa, plan.breast.young_left_kpa)
    }

    /// Modulus of a side (kPa).
    pub fn of_side(&self, side: Side) -> f64 {
        match side {
            Side::Right => self.right_kpa,
            Side::Left => self.left_kpa,
        }
    }

    /// The moduli of the breasts times these; what both share stays.
    pub fn times(self, right: f64, left: f64) -> Self {
        Self { right_kpa: right * self.right_kpa, left_kpa: left * self.left_kpa, ..self }
    }

    /// A plan with these numbers.
    pub fn applied(&self, plan: &ModelPlan) -> ModelPlan {
        let mut plan = plan.clone();
        plan.breast.young_right_kpa = self.right_kpa;
        plan.breast.young_left_kpa = self.left_kpa;
        let shared = &self.shared;
        for (value, of) in [
            (shared.skin_kpa, &mut plan.skin.young_kpa),
            (shared.fascia_kpa, &mut plan.fascia.young_kpa),
            (shared.ligaments_kpa, &mut plan.ligaments.young_kpa),
        ] {
            *of = value.unwrap_or(*of);
        }
        plan.breast.jm = shared.breast_jm.or(plan.breast.jm);
        plan.skin.jm = shared.skin_jm.or(plan.skin.jm);
        plan.fascia.jm = shared.fascia_jm.or(plan.fascia.jm);
        plan
    }
}
