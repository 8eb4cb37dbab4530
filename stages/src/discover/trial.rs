//! Trials of the verdict: drawn errors on evidence that has none, or on less of it.

use super::{Budget, Evidence, RigidError};
use mammotwin_data::Failure;
use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// Draws errors of measured skins.
pub struct Errors {
    factor: DMatrix<f64>,
    shifts_mm: Vec<DVector<f64>>,
}

impl Errors {
    /// Errors of the sizes of a budget and of rigid motions.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when the budget has no covariance.
    pub fn new(evidence: &Evidence, budget: &Budget, rigid: RigidError) -> Result<Self, Failure> {
        let covariance = budget.measured(&evidence.places(), rigid);
        let factor = covariance
            .cholesky()
            .ok_or_else(|| Failure::Numerics("discover: errors without a covariance".into()))?;
        let nodes = evidence.nodes();
        let all = nodes * evidence.shapes.len();
        let one = |p: usize| DVector::from_fn(all, |n, _| if n / nodes == p { 1.0 } else { 0.0 });
        let shifts_mm = (0..evidence.shapes.len()).map(one).collect();
        Ok(Self { factor: factor.unpack(), shifts_mm })
    }

    /// One draw (mm), all poses.
    pub fn draw(&self, random: &mut impl Rng) -> DVector<f64> {
        let white = DVector::from_fn(self.factor.nrows(), |_, _| StandardNormal.sample(random));
        &self.factor * white
    }

    /// Surfaces of all poses that lie `mm` too far out or in, pose by pose at random.
    pub fn biased(&self, mm: f64, random: &mut impl Rng) -> DVector<f64> {
        let mut sum = DVector::zeros(self.factor.nrows());
        for shift in &self.shifts_mm {
            sum += if random.random_bool(0.5) { mm } else { -mm } * shift;
        }
        sum
    }
}

impl Evidence {
    /// The same with errors (mm) on top; how rough they are is measured anew in the seen poses.
    pub fn with_errors(&self, errors: &DVector<f64>) -> Self {
        let residual = &self.residual + errors;
        let budget = Budget::of(&self.places(), &residual, &self.seen(), self.budget.voxel_mm);
        Self { residual, budget, ..self.clone() }
    }

    /// The same for a library that lacks an effect.
    pub fn without_effect(&self, name: &str) -> Self {
        let mut less = self.clone();
        less.signatures.retain(|signature| signature.effect.name != name);
        less
    }
}
