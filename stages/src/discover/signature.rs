//! What an effect changes about the residuals, and how well that explains them.
//!
//! A breast that stiffens as it is stretched is stretched less: large amplitudes change less than in
//! proportion. A signature therefore knows a small change and a large one, each from whole solutions. At
//! the large one the moduli are those that a calibration would find with it: so are the moduli of the data.
//! Both are means over several meshes, of which none lies as the model's does.

use super::{
    budget::Whitener,
    chance::Curve,
    course::{Change, Course},
};
use crate::{
    effects::Effect,
    span::{least_squares, orthonormal, without},
};
use mammotwin_data::{Failure, io::hdf5};
use nalgebra::{DMatrix, DVector};

/// The change (mm) of the residuals of all poses by an effect.
#[derive(Debug, Clone)]
pub struct Signature {
    /// The effect.
    pub effect: &'static Effect,
    /// Up to the large amplitude [`Signature::reach`], where moduli are as a calibration finds them and their own
    /// part is taken off.
    pub course: Course,
    /// Size of the large amplitude. Beyond it changes go on in proportion.
    pub reach: f64,
    /// Plausible amplitudes: on top of what the study has of the effect already.
    pub range: [f64; 2],
}

impl Signature {
    /// Of a small amplitude and the change by it, and a large one with the moduli of a calibration.
    pub(super) fn new(
        effect: &'static Effect,
        range: [f64; 2],
        small: (f64, &Change),
        large: Option<(f64, &Change)>,
    ) -> Self {
        let reach = large.map_or(small.0, |(amplitude, _)| amplitude).abs();
        Self { effect, course: Course::through(small, large), reach, range }
    }

    /// Of a small amplitude and the change (mm) by it on the model's own mesh, for an effect that hardly shows.
    pub(super) fn small(
        effect: &'static Effect,
        range: [f64; 2],
        amplitude: f64,
        own: DVector<f64>,
    ) -> Self {
        let change = Change { off: DVector::zeros(own.len()), mean: own };
        Self::new(effect, range, (amplitude, &change), None)
    }

    /// The change (mm) by an amplitude.
    pub fn change(&self, amplitude: f64) -> DVector<f64> {
        self.course.mean.sum(amplitude, bent(amplitude, self.reach))
    }

    /// What the change (mm) by an amplitude is off on the model's own mesh.
    pub(super) fn off(&self, amplitude: f64) -> DVector<f64> {
        self.course.off.sum(amplitude, bent(amplitude, self.reach))
    }

    /// Derivative (mm) of the change by the amplitude, at an amplitude.
    pub(super) fn rate(&self, amplitude: f64) -> DVector<f64> {
        self.course.mean.sum(1.0, bent_rate(amplitude, self.reach))
    }

    /// The large amplitude, with the sign of the largest plausible one.
    pub(super) fn far(&self) -> f64 {
        farthest(self.range).signum() * self.reach
    }

    /// Some of the rows.
    pub(super) fn of(&self, rows: impl Fn(&DVector<f64>) -> DVector<f64>) -> Self {
        Self { course: self.course.of(&rows), ..*self }
    }

    pub(super) fn put(&self, file: &mut hdf5::Writer) -> Result<(), Failure> {
        let group = format!("signatures/{}", self.effect.name);
        self.course.put(file, &group)?;
        let reach = format!("{group}/reach");
        file.put(&reach, &[self.reach], "1", "amplitude up to which it bends")?;
        Ok(file.put(&format!("{group}/range"), &self.range, "1", "plausible amplitudes")?)
    }

    /// `None` when the file has no signature of this effect.
    pub(super) fn get(
        file: &hdf5::Reader,
        effect: &'static Effect,
    ) -> Result<Option<Self>, Failure> {
        let group = format!("signatures/{}", effect.name);
        if !file.has(&group) {
            return Ok(None);
        }
        let reach: Vec<f64> = file.get(&format!("{group}/reach"))?;
        let reach = reach.first().copied().unwrap_or_default();
        let range: Vec<f64> = file.get(&format!("{group}/range"))?;
        let range = std::array::from_fn(|n| range.get(n).copied().unwrap_or_default());
        Ok(Some(Self { effect, course: Course::get(file, &group)?, reach, range }))
    }
}

/// Factor of the curvature: the square of the amplitude, in proportion beyond the reach.
fn bent(amplitude: f64, reach: f64) -> f64 {
    amplitude.abs() * amplitude.abs().min(reach)
}

/// Its derivative.
fn bent_rate(amplitude: f64, reach: f64) -> f64 {
    amplitude.signum() * if amplitude.abs() > reach { reach } else { 2.0 * amplitude.abs() }
}

/// What is left of whitened residuals when moduli are fitted, linearly.
pub(super) struct Projector<'a> {
    whitener: &'a Whitener,
    absorbed: DMatrix<f64>,
    basis: DMatrix<f64>,
}

impl<'a> Projector<'a> {
    /// `moduli` are derivatives (mm) by what is fitted anyway.
    pub fn new(whitener: &'a Whitener, moduli: &[DVector<f64>]) -> Self {
        let absorbed: Vec<DVector<f64>> = moduli.iter().map(|m| whitener.whiten(m)).collect();
        let (absorbed, basis) = match absorbed.is_empty() {
            true => (DMatrix::zeros(0, 0), DMatrix::zeros(0, 0)),
            false => {
                let absorbed = DMatrix::from_columns(&absorbed);
                // A modulus that changes nothing absorbs nothing.
                let basis = orthonormal(&absorbed);
                (absorbed, basis)
            }
        };
        Self { whitener, absorbed, basis }
    }

    /// The changes of what is fitted that take most off a change (mm); zeros where nothing does.
    pub fn fitted(&self, change: &DVector<f64>) -> [f64; 2] {
        let found = least_squares(&self.absorbed, &self.whitener.whiten(change));
        [0, 1].map(|n| found.get(n).copied().unwrap_or(0.0))
    }

    /// Whitened, without what moduli absorb; and the part of its length that is left.
    pub fn surviving(&self, column: &DVector<f64>) -> (DVector<f64>, f64) {
        let white = self.whitener.whiten(column);
        let left = match self.basis.ncols() {
            0 => white.clone(),
            _ => without(&self.basis, &white),
        };
        let part = left.norm() / white.norm().max(f64::MIN_POSITIVE);
        (left, part)
    }

    /// What survives of an effect's change, as chance is drawn with it.
    pub fn curve(&self, signature: &Signature) -> Curve {
        let reach = signature.reach;
        let [slope, curve] = [&signature.course.mean.slope, &signature.course.mean.curve]
            .map(|column| self.surviving(column).0);
        let range = signature.range.map(|end| end / reach);
        Curve { slope: reach * slope, curve: reach * reach * curve, range }
    }

    /// How well amplitudes of an effect explain `rest`, which survived.
    pub fn explain(&self, signature: &Signature, rest: &DVector<f64>) -> Explained {
        let (slope, _) = self.surviving(&signature.course.mean.slope);
        let (curve, _) = self.surviving(&signature.course.mean.curve);
        Explained {
            rest: [rest.dot(&slope), rest.dot(&curve)],
            products: [slope.dot(&slope), slope.dot(&curve), curve.dot(&curve)],
            range: signature.range,
            reach: signature.reach,
        }
    }
}

/// The misfit as a function of the amplitude of an effect.
pub(super) struct Explained {
    /// Products of the residuals with slope and curve.
    rest: [f64; 2],
    /// Products of slope and curve with themselves.
    products: [f64; 3],
    range: [f64; 2],
    reach: f64,
}

/// How far a step (any unit) leads out of a range from an amplitude at its end; zero elsewhere.
pub(super) fn beyond([least, greatest]: [f64; 2], amplitude: f64, step: f64) -> f64 {
    let near = 1e-6 * (greatest - least);
    let out = if amplitude > greatest - near {
        step
    } else if amplitude < least + near {
        -step
    } else {
        0.0
    };
    out.max(0.0)
}

/// Amplitudes that are tried, and refinements of the best.
const TRIED: usize = 200;
const REFINED: usize = 40;

impl Explained {
    /// Size of the change by an amplitude, in standard deviations.
    pub fn size(&self, amplitude: f64) -> f64 {
        let (a, b) = (amplitude, bent(amplitude, self.reach));
        let [slope, mixed, curve] = self.products;
        (a * a * slope + 2.0 * a * b * mixed + b * b * curve).max(0.0).sqrt()
    }

    /// Size of the derivative of the change by the amplitude.
    pub fn rate(&self, amplitude: f64) -> f64 {
        let b = bent_rate(amplitude, self.reach);
        let [slope, mixed, curve] = self.products;
        (slope + 2.0 * b * mixed + b * b * curve).max(0.0).sqrt()
    }

    /// By how much the squared misfit falls.
    fn gain(&self, amplitude: f64) -> f64 {
        let b = bent(amplitude, self.reach);
        -2.0 * (amplitude * self.rest[0] + b * self.rest[1]) - self.size(amplitude).powi(2)
    }

    /// By how many of its standard deviations an amplitude at the end of the plausible range would go beyond it; zero
    /// elsewhere.
    pub fn beyond(&self, amplitude: f64) -> f64 {
        let (a, b) = (amplitude, bent(amplitude, self.reach));
        let slope = bent_rate(amplitude, self.reach);
        let [own, mixed, curve] = self.products;
        // Half of the derivative of the gain.
        let pull = -(self.rest[0] + slope * self.rest[1])
            - (a * own + (b + a * slope) * mixed + b * slope * curve);
        beyond(self.range, amplitude, pull / self.rate(amplitude).max(f64::MIN_POSITIVE))
    }

    /// The plausible amplitude that explains most, and its gain.
    pub fn best(&self) -> (f64, f64) {
        let [least, greatest] = self.range;
        let step = (greatest - least) / TRIED as f64;
        let tried = (0..=TRIED).map(|n| least + n as f64 * step);
        let best = |a: f64, b: f64| if self.gain(a) >= self.gain(b) { a } else { b };
        let mut at = tried.fold(0.0, best);
        let mut width = step;
        for _ in 0..REFINED {
            width *= 0.7;
            for next in [at - width, at + width] {
                at = best(at, next.clamp(least, greatest));
            }
        }
        (at, self.gain(at).max(0.0))
    }

    /// The least amplitude, of the sign of the largest plausible one, whose change has a size (standard deviations); `None`
    /// where no plausible one has.
    pub fn amplitude_of(&self, size: f64) -> Option<f64> {
        let step = farthest(self.range) / TRIED as f64;
        let above = (1..=TRIED).map(|n| n as f64 * step).find(|&a| self.size(a) >= size)?;
        let mut between = [above - step, above];
        for _ in 0..REFINED {
            let middle = 0.5 * (between[0] + between[1]);
            between[usize::from(self.size(middle) >= size)] = middle;
        }
        Some(between[1])
    }

    /// Size of the change by the largest plausible amplitude.
    pub fn largest(&self) -> f64 {
        self.size(farthest(self.range))
    }
}

/// The end of a range of amplitudes that is farther from nothing, the greatest where both are alike: there changes are computed.
pub(super) fn farthest([least, greatest]: [f64; 2]) -> f64 {
    if -least > greatest { least } else { greatest }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;

    /// A change that saturates: 1 - exp(-a) along one row, and its square along another.
    fn saturating(amplitude: f64) -> DVector<f64> {
        let part = 1.0 - (-amplitude).exp();
        DVector::from_vec(vec![part, 0.3 * part * part, 0.0])
    }

    fn signature() -> Signature {
        let effect = Effect::named("limit_chain").unwrap();
        let exact = |a: f64| Change { off: DVector::zeros(3), mean: saturating(a) };
        let range = effect.amplitude.range;
        Signature::new(effect, range, (0.05, &exact(0.05)), Some((0.8, &exact(0.8))))
    }

    #[test]
    fn a_signature_of_less_of_an_effect_goes_through_both_changes_too() {
        let effect = Effect::named("limit_chain").unwrap();
        let exact = |a: f64| Change { off: DVector::zeros(3), mean: -saturating(-a) };
        let (small, large) = ((-0.05, &exact(-0.05)), Some((-0.8, &exact(-0.8))));
        let signature = Signature::new(effect, [-1.1, 0.1], small, large);
        for amplitude in [-0.05, -0.8] {
            let off = signature.change(amplitude) - exact(amplitude).mean;
            assert!(off.norm() < 1e-12, "{amplitude}: {off}");
        }
        let whitener = Whitener::new(&DMatrix::identity(3, 3), &[0], 3).unwrap();
        let projector = Projector::new(&whitener, &[]);
        let rest = -signature.change(-0.6);
        let (found, _) = projector.explain(&signature, &rest).best();
        assert!((found + 0.6).abs() < 1e-3, "{found}");
    }

    #[test]
    fn a_signature_goes_through_both_changes_and_nothing() {
        let signature = signature();
        for amplitude in [0.0, 0.05, 0.8] {
            let off = signature.change(amplitude) - saturating(amplitude);
            assert!(off.norm() < 1e-12, "{amplitude}: {off}");
        }
        let far = signature.change(1.6) - 2.0 * saturating(0.8);
        assert!(far.norm() < 1e-12);
        for amplitude in [-1.2, -0.3, 0.3, 1.2] {
            let step = 1e-6;
            let change = signature.change(amplitude + step) - signature.change(amplitude - step);
            let off = signature.rate(amplitude) - change / (2.0 * step);
            assert!(off.norm() < 1e-8, "{amplitude}: {off}");
        }
    }

    #[test]
    fn what_a_mesh_is_off_is_taken_from_its_own_changes() {
        let effect = Effect::named("limit_chain").unwrap();
        let own = |a: f64| saturating(a) + DVector::from_vec(vec![0.0, 0.0, a - 0.4 * a * a]);
        let off = |a: f64| Change { off: own(a) - saturating(a), mean: saturating(a) };
        let signature = Signature::new(
            effect,
            effect.amplitude.range,
            (0.05, &off(0.05)),
            Some((0.8, &off(0.8))),
        );
        for a in [0.05, 0.3, 0.8] {
            assert!((own(a) - signature.off(a) - saturating(a)).norm() < 1e-12, "{a}");
        }
        // Beyond the reach the mesh is off in proportion.
        assert!((signature.off(1.6) - 2.0 * off(0.8).off).norm() < 1e-12);
    }

    #[test]
    fn the_amplitude_of_data_is_found_although_it_saturates() {
        let signature = signature();
        let whitener = Whitener::new(&DMatrix::identity(3, 3), &[0], 3).unwrap();
        let projector = Projector::new(&whitener, &[]);
        for amplitude in [0.1, 0.5, 0.8] {
            let rest = -signature.change(amplitude);
            let explained = projector.explain(&signature, &rest);
            let (found, gain) = explained.best();
            assert!((found - amplitude).abs() < 1e-3, "{found} {amplitude}");
            let size = explained.size(amplitude);
            assert!((gain - size * size).abs() < 1e-6);
            let step = 1e-6;
            let change = signature.change(amplitude + step) - signature.change(amplitude);
            // Up to the reach, where it bends.
            if amplitude < 0.8 {
                assert!((explained.rate(amplitude) - change.norm() / step).abs() < 1e-4);
            }
        }
        // Data of more than is plausible: by how much, in standard deviations.
        let [_, greatest] = signature.effect.amplitude.range;
        let rest = -signature.change(1.1 * greatest);
        let explained = projector.explain(&signature, &rest);
        let (found, _) = explained.best();
        assert!((found - greatest).abs() < 1e-9);
        let out = 0.1 * greatest * explained.rate(greatest);
        assert!((explained.beyond(found) / out - 1.0).abs() < 1e-6);
        assert_eq!(explained.beyond(0.5), 0.0);
        assert_eq!(projector.explain(&signature, &DVector::zeros(3)).best(), (0.0, 0.0));
        assert_eq!(projector.explain(&signature, &saturating(0.5)).best().0, 0.0);
        let explained = projector.explain(&signature, &DVector::zeros(3));
        for amplitude in [0.02, 0.3, 0.8] {
            let found = explained.amplitude_of(signature.change(amplitude).norm()).unwrap();
            assert!((found - amplitude).abs() < 1e-9, "{found} {amplitude}");
        }
        assert!(explained.amplitude_of(1.01 * explained.largest()).is_none());
    }

    #[test]
    fn what_moduli_absorb_explains_nothing() {
        let whitener = Whitener::new(&DMatrix::identity(3, 3), &[0], 3).unwrap();
        let absorbed = DVector::from_vec(vec![2.0, 0.0, 0.0]);
        let projector = Projector::new(&whitener, &[absorbed]);
        let (left, part) = projector.surviving(&DVector::from_vec(vec![3.0, 4.0, 0.0]));
        assert!((left - DVector::from_vec(vec![0.0, 4.0, 0.0])).norm() < 1e-12);
        assert!((part - 0.8).abs() < 1e-12);
        // Nor does a modulus that changes nothing absorb anything.
        let inert = DVector::zeros(3);
        let absorbed = DVector::from_vec(vec![2.0, 0.0, 0.0]);
        for moduli in [[inert.clone(), absorbed.clone()], [absorbed, inert]] {
            let projector = Projector::new(&whitener, &moduli);
            let (left, _) = projector.surviving(&DVector::from_vec(vec![3.0, 4.0, 5.0]));
            assert!((left - DVector::from_vec(vec![0.0, 4.0, 5.0])).norm() < 1e-12);
            let [a, b] = projector.fitted(&DVector::from_vec(vec![3.0, 4.0, 5.0]));
            assert!((a + b + 1.5).abs() < 1e-12 && a * b == 0.0, "{a} {b}");
        }
    }
}
