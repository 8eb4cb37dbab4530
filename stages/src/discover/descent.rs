//! The least misfit of whole solutions: Gauss-Newton with Broyden's updates, the last unknown within a range.

use crate::span::least_squares;
use mammotwin_data::Failure;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Solutions of one fit at most, but those of derivatives.
const MOST: usize = 10;
/// A fit ends when the misfit falls by less than this (it counts squared standard deviations).
const ENOUGH: f64 = 0.2;
/// After the last solution that is allowed, a fit has ended if its derivatives promise less than this.
const UNFINISHED: f64 = 1.0;
/// Largest change of one of the other unknowns (logarithms of moduli) in one step.
const STRIDE: f64 = 0.5;
/// Smallest part of a step that is tried, and what a step that failed is shortened to.
const LEAST_DAMPING: f64 = 0.05;
const SHORTER: f64 = 0.4;

/// What is fitted.
pub(super) trait Model: Sync {
    /// What is kept of a solution.
    type Solution: Send + Sync;

    /// The solution with these unknowns, near another one, and its residuals in standard deviations.
    ///
    /// # Errors
    /// [`Failure::Numerics`] where the model does not stand.
    fn solve(
        &self,
        unknowns: &DVector<f64>,
        near: &Self::Solution,
    ) -> Result<(DVector<f64>, Self::Solution), Failure>;
}

/// Where a fit stands.
pub(super) struct State<S> {
    pub unknowns: DVector<f64>,
    /// In standard deviations.
    pub residual: DVector<f64>,
    pub solution: S,
}

impl<S> State<S> {
    pub fn misfit(&self) -> f64 {
        self.residual.norm_squared()
    }
}

/// Of the unknowns.
pub(super) struct Limits {
    /// Steps of their derivatives.
    pub small: Vec<f64>,
    /// Of the last one; `None` where none has a range.
    pub range: Option<[f64; 2]>,
}

impl Limits {
    /// The step that makes the residuals least where they are linear. One that leads out of the range ends at it, and the
    /// other unknowns are fitted to that: without their part cut off alone a step would not lead downhill.
    fn step<S>(&self, jacobian: &DMatrix<f64>, at: &State<S>) -> DVector<f64> {
        let whole = least_squares(jacobian, &at.residual);
        let Some([least, greatest]) = self.range else { return whole };
        let last = whole.len() - 1;
        let to = at.unknowns[last] + whole[last];
        if (least..=greatest).contains(&to) {
            return whole;
        }
        let held = to.clamp(least, greatest) - at.unknowns[last];
        let rest = &at.residual + held * jacobian.column(last);
        let others = least_squares(&jacobian.columns(0, last).into_owned(), &rest);
        others.insert_row(last, held)
    }

    /// The unknowns after a part of such a step, which is no longer than [`STRIDE`].
    fn next<S>(&self, jacobian: &DMatrix<f64>, at: &State<S>, part: f64) -> DVector<f64> {
        let step = part * self.step(jacobian, at);
        let free = step.len() - usize::from(self.range.is_some());
        let longer = step.rows(0, free).amax() / STRIDE;
        self.within(&at.unknowns + step / longer.max(1.0))
    }

    fn within(&self, mut unknowns: DVector<f64>) -> DVector<f64> {
        if let (Some([least, greatest]), Some(last)) = (self.range, unknowns.len().checked_sub(1)) {
            unknowns[last] = unknowns[last].clamp(least, greatest);
        }
        unknowns
    }
}

/// How a fit ended.
pub(super) struct End<S> {
    /// The best solution.
    pub at: State<S>,
    /// Derivatives of the residuals there.
    pub jacobian: DMatrix<f64>,
    /// Why this is no least misfit, if it is none.
    pub unsettled: Option<String>,
}

/// Fits from a solution; the first other one that is tried has the unknowns `first`. Where the fit stalls, derivatives are
/// taken anew, once.
pub(super) fn descend<M: Model>(
    model: &M,
    start: State<M::Solution>,
    first: DVector<f64>,
    mut jacobian: DMatrix<f64>,
    limits: &Limits,
) -> End<M::Solution> {
    let mut at = start;
    let mut next = limits.within(first);
    let (mut damping, mut fresh) = (1.0, false);
    let (mut tried, mut failed) = (0, Vec::new());
    let mut settled = None;
    for _ in 0..MOST {
        let step = &next - &at.unknowns;
        let mut stalled = step.norm() == 0.0;
        let mut stands = true;
        if !stalled {
            tried += 1;
            match model.solve(&next, &at.solution) {
                Ok((residual, solution)) => {
                    let trial = State { unknowns: next, residual, solution };
                    let change = &trial.residual - &at.residual - &jacobian * &step;
                    broyden(&mut jacobian, &change, &step);
                    let gain = at.misfit() - trial.misfit();
                    if gain > 0.0 {
                        (at, damping) = (trial, 1.0);
                    } else {
                        damping *= SHORTER;
                    }
                    stalled = gain.abs() < ENOUGH;
                }
                Err(why) => {
                    failed.push(why.to_string());
                    stands = false;
                    damping *= SHORTER;
                }
            }
            stalled |= damping < LEAST_DAMPING;
        }
        if stalled {
            if fresh {
                settled = Some(stands);
                break;
            }
            match derivatives(model, &at, limits) {
                Ok(found) => (jacobian, fresh, damping) = (found, true, 1.0),
                Err(why) => {
                    tried += 1;
                    failed.push(why.to_string());
                    settled = Some(false);
                    break;
                }
            }
        }
        next = limits.next(&jacobian, &at, damping);
    }
    let unfinished = || {
        let step = limits.step(&jacobian, &at);
        at.misfit() - (&at.residual + &jacobian * step).norm_squared()
    };
    let settled = settled.unwrap_or_else(|| failed.len() < tried && unfinished() < UNFINISHED);
    let unsettled = match failed.last() {
        _ if settled => None,
        Some(why) => Some(format!("{} of {tried} solutions failed ({why})", failed.len())),
        None => Some(format!("the misfit still falls after {tried} solutions")),
    };
    End { at, jacobian, unsettled }
}

/// Derivatives of the residuals by differences.
fn derivatives<M: Model>(
    model: &M,
    at: &State<M::Solution>,
    limits: &Limits,
) -> Result<DMatrix<f64>, Failure> {
    let column = |(n, &small): (usize, &f64)| {
        let greatest = limits.range.filter(|_| n + 1 == limits.small.len()).map(|[_, most]| most);
        let backward = greatest.is_some_and(|greatest| at.unknowns[n] + small > greatest);
        let step = if backward { -small } else { small };
        let mut there = at.unknowns.clone();
        there[n] += step;
        let (residual, _) = model.solve(&there, &at.solution)?;
        Ok((residual - &at.residual) / step)
    };
    let columns: Result<Vec<DVector<f64>>, Failure> =
        limits.small.par_iter().enumerate().map(column).collect();
    Ok(DMatrix::from_columns(&columns?))
}

/// Broyden's update in units in which each unknown changes the residuals alike: what a step changed beyond
/// what `jacobian` told.
fn broyden(jacobian: &mut DMatrix<f64>, change: &DVector<f64>, step: &DVector<f64>) {
    let weights = DVector::from_iterator(
        jacobian.ncols(),
        jacobian.column_iter().map(|column| column.norm_squared()),
    );
    let along = step.component_mul(&weights);
    let length = step.dot(&along);
    if length > 0.0 {
        jacobian.ger(1.0 / length, change, &along, 1.0);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;

    /// Linear residuals with a bend; it has no solution where the third unknown is beyond an end.
    struct Bending {
        end: f64,
    }

    /// What moduli and an amplitude change: they resemble each other, as effects and moduli do.
    fn slopes() -> DMatrix<f64> {
        DMatrix::from_column_slice(
            4,
            3,
            &[3.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 1.0, 2.0, 1.5, 1.0, 0.3],
        )
    }

    impl Model for Bending {
        type Solution = ();

        fn solve(&self, unknowns: &DVector<f64>, (): &()) -> Result<(DVector<f64>, ()), Failure> {
            if unknowns[2].abs() > self.end {
                return Err(Failure::Numerics("it does not stand".into()));
            }
            let bent = unknowns.map(|x| x - 0.1 * x * x);
            let aim = DVector::from_row_slice(&[3.6, 0.9, 1.2, -0.3]);
            Ok((slopes() * bent - aim, ()))
        }
    }

    fn fit(model: &Bending, range: [f64; 2], first: f64) -> End<()> {
        let none = DVector::zeros(3);
        let residual = Bending { end: 1.0 }.solve(&none, &()).unwrap().0;
        let start = State { unknowns: none, residual, solution: () };
        let limits = Limits { small: vec![0.01; 3], range: Some(range) };
        descend(model, start, DVector::from_row_slice(&[0.0, 0.0, first]), slopes(), &limits)
    }

    /// The least misfit with a third unknown that stays, by Newton's method on the other two.
    fn least(third: f64) -> f64 {
        let model = Bending { end: f64::INFINITY };
        let mut at = DVector::from_row_slice(&[0.0, 0.0, third]);
        for _ in 0..50 {
            let (residual, ()) = model.solve(&at, &()).unwrap();
            let slope = |n: usize| slopes().column(n) * (1.0 - 0.2 * at[n]);
            let step = least_squares(&DMatrix::from_columns(&[slope(0), slope(1)]), &residual);
            at[0] += step[0];
            at[1] += step[1];
        }
        model.solve(&at, &()).unwrap().0.norm_squared()
    }

    #[test]
    fn at_the_end_of_a_range_the_others_are_fitted_to_it() {
        let free = Bending { end: f64::INFINITY };
        for greatest in [0.05, 0.4, 1.0] {
            let end = fit(&free, [0.0, greatest], greatest);
            assert_eq!(end.at.unknowns[2], greatest);
            let off = end.at.misfit() - least(greatest);
            assert!(off.abs() < ENOUGH && end.unsettled.is_none(), "{greatest}: {off}");
        }
        // A step cut off in its last part alone leads uphill.
        let residual = free.solve(&DVector::zeros(3), &()).unwrap().0;
        let at = State { unknowns: DVector::zeros(3), residual, solution: () };
        let limits = Limits { small: vec![0.01; 3], range: Some([0.0, 0.05]) };
        let told = |step: &DVector<f64>| (&at.residual + slopes() * step).norm_squared();
        let mut cut = least_squares(&slopes(), &at.residual);
        cut[2] = cut[2].min(0.05);
        let step = limits.step(&slopes(), &at);
        assert!(told(&step) < at.misfit() && told(&step) < told(&cut) - 1.0);
        let others = slopes().columns(0, 2).transpose() * (&at.residual + slopes() * &step);
        assert!(others.norm() < 1e-9, "{others}");
    }

    #[test]
    fn failed_solutions_are_told_and_are_no_fit() {
        // None but the start, which has none of the third unknown.
        let end = fit(&Bending { end: -1.0 }, [0.0, 2.0], 1.0);
        let why = end.unsettled.unwrap();
        assert!(why.contains("it does not stand"), "{why}");
        assert_eq!(end.at.unknowns.norm(), 0.0);
        // Up to an end that lies before the least misfit: the last solutions fail.
        let end = fit(&Bending { end: 0.5 }, [0.0, 2.0], 1.0);
        assert!(end.unsettled.is_some() && end.at.misfit() > least(1.17) + UNFINISHED);
        // A first guess that fails is made good.
        let end = fit(&Bending { end: 1.5 }, [0.0, 2.0], 2.0);
        assert!(end.unsettled.is_none() && end.at.misfit() < least(1.17) + ENOUGH);
    }

    #[test]
    fn an_update_does_not_depend_on_units() {
        let columns = [[1.0, 0.2, 0.0], [0.3, 2.0, 0.1]];
        let [first, second] = columns.map(|c| DVector::from_row_slice(&c));
        let mut plain = DMatrix::from_columns(&[first.clone(), second.clone()]);
        // The second unknown in thousandths.
        let mut scaled = DMatrix::from_columns(&[first, &second / 1000.0]);
        let change = DVector::from_row_slice(&[0.1, -0.3, 0.5]);
        let step = DVector::from_row_slice(&[0.4, 0.7]);
        let before = &plain * &step;
        broyden(&mut plain, &change, &step);
        broyden(&mut scaled, &change, &DVector::from_row_slice(&[0.4, 700.0]));
        assert!((&plain * &step - before - &change).norm() < 1e-12);
        assert!((scaled.column(1) * 1000.0 - plain.column(1)).norm() < 1e-9);
        assert!((scaled.column(0) - plain.column(0)).norm() < 1e-12);
    }
}
