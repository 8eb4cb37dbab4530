//! How residuals change with a number, as several meshes agree, and what the model's own mesh is off.

use mammotwin_data::{Failure, io::hdf5};
use nalgebra::DVector;

/// A change (mm) of the residuals of all poses.
pub(super) struct Change {
    /// Mean over several meshes.
    pub mean: DVector<f64>,
    /// What the model's own mesh is off from it.
    pub off: DVector<f64>,
}

impl Change {
    /// What is left when the moduli's part goes, their logarithms being changed by `at`.
    pub fn without(mut self, moduli: &[Course; 2], at: [f64; 2]) -> Self {
        for (course, at) in moduli.iter().zip(at) {
            self.mean -= course.mean.sum(at, at * at);
            self.off -= course.off.sum(at, at * at);
        }
        self
    }
}

/// A change (mm) that is in proportion to a number, and one with its square.
#[derive(Debug, Clone)]
pub struct Bent {
    /// Derivative (mm) at zero.
    pub slope: DVector<f64>,
    /// Half of the second derivative (mm).
    pub curve: DVector<f64>,
}

impl Bent {
    /// Through nothing, the change (mm) by a small number, and that by a large one.
    fn through((small, little): (f64, DVector<f64>), large: Option<(f64, DVector<f64>)>) -> Self {
        let mut slope = little / small;
        let mut curve = DVector::zeros(slope.len());
        if let Some((far, much)) = large {
            curve = (much / far - &slope) / (far - small);
            slope -= small * &curve;
        }
        Self { slope, curve }
    }

    /// So many slopes and curves.
    pub(super) fn sum(&self, slopes: f64, curves: f64) -> DVector<f64> {
        slopes * &self.slope + curves * &self.curve
    }

    fn of(&self, rows: impl Fn(&DVector<f64>) -> DVector<f64>) -> Self {
        Self { slope: rows(&self.slope), curve: rows(&self.curve) }
    }
}

/// How the residuals (mm) of all poses change with a number.
#[derive(Debug, Clone)]
pub struct Course {
    /// Mean over several meshes.
    pub mean: Bent,
    /// What the model's own mesh is off from it.
    pub off: Bent,
}

impl Course {
    /// Through nothing, the change by a small number, and that by a large one.
    pub(super) fn through(small: (f64, &Change), large: Option<(f64, &Change)>) -> Self {
        let mean = |(number, change): (f64, &Change)| (number, change.mean.clone());
        let off = |(number, change): (f64, &Change)| (number, change.off.clone());
        Self {
            mean: Bent::through(mean(small), large.map(mean)),
            off: Bent::through(off(small), large.map(off)),
        }
    }

    /// Some of the rows.
    pub(super) fn of(&self, rows: impl Fn(&DVector<f64>) -> DVector<f64>) -> Self {
        Self { mean: self.mean.of(&rows), off: self.off.of(&rows) }
    }

    pub(super) fn put(&self, file: &mut hdf5::Writer, group: &str) -> Result<(), Failure> {
        for (name, bent, of) in [("", &self.mean, ""), ("off_", &self.off, ", own mesh less it")] {
            let slope = format!("derivative, mean over meshes{of}");
            file.put(&format!("{group}/{name}slope"), bent.slope.as_slice(), "mm", &slope)?;
            let curve = format!("half of the second derivative, mean over meshes{of}");
            file.put(&format!("{group}/{name}curve"), bent.curve.as_slice(), "mm", &curve)?;
        }
        Ok(())
    }

    pub(super) fn get(file: &hdf5::Reader, group: &str) -> Result<Self, Failure> {
        let read = |name: &str| file.get::<f64>(&format!("{group}/{name}")).map(DVector::from_vec);
        let bent = |name: &str| {
            let [slope, curve] = ["slope", "curve"].map(|part| read(&format!("{name}{part}")));
            Ok::<_, Failure>(Bent { slope: slope?, curve: curve? })
        };
        Ok(Self { mean: bent("")?, off: bent("off_")? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_change_goes_without_the_part_of_its_moduli() {
        let bent = |slope: f64, curve: f64| Bent {
            slope: DVector::from_element(1, slope),
            curve: DVector::from_element(1, curve),
        };
        let moduli = [2.0, -1.0]
            .map(|part| Course { mean: bent(part, 0.5 * part), off: bent(0.1 * part, 0.0) });
        let of = |value: f64| DVector::from_element(1, value);
        let at = [0.4, 0.2];
        let left = Change { mean: of(3.0), off: of(0.3) }.without(&moduli, at);
        let taken = 2.0 * 0.4 + 0.16 - 0.2 - 0.5 * 0.04;
        assert!((left.mean[0] - (3.0 - taken)).abs() < 1e-12);
        assert!((left.off[0] - (0.3 - 0.1 * (0.8 - 0.2))).abs() < 1e-12);
    }
}
