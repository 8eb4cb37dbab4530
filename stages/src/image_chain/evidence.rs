//! What was measured of a unit, what the image model says of it, and how sure both are.

use super::{
    field::{ChainError, Field},
    grains::Grains,
    library::{Chain, IMAGE_EFFECTS},
};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Uneven gain of the detector that its own correction leaves (relative, standard deviation), and its
/// length (mm).
pub const UNEVEN: f64 = 0.003;
/// See [`UNEVEN`].
pub const UNEVEN_LENGTH_MM: f64 = 25.0;
/// Error of a cell of its own (relative): quantum noise is 0.015 %, the rest is that of scatter by Monte
/// Carlo.
const CELL: f64 = 0.001;
/// Error of a dose over that under a flat paddle (relative).
const DOSE: f64 = 0.0035;
/// Counted quanta per pixel of 0.1 mm.
pub const QUANTA: f64 = 17_424.0;

/// Steps of a fit, halvings of a step, and the fall of the misfit (squared standard deviations) below which
/// it has settled.
const STEPS: usize = 30;
const HALVINGS: usize = 8;
const SETTLED: f64 = 0.01;

/// What is X-rayed.
#[derive(Debug, Clone)]
pub enum Object {
    /// A smooth body: logarithmic signals of cells. Whether its composition is uncertain.
    Field(Field, Composition),
    /// A test object: contrasts of rings around grains.
    Grains(Grains),
    /// Doses under tilted paddles over those under flat ones, as logarithms, by relative wedge.
    Doses(Vec<f64>),
}

/// Whether it is known what a body is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Composition {
    /// A breast: its glandularity is fitted.
    Fitted,
    /// A slab of known make.
    Known,
}

/// Numbers that are fitted, and the image model.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// Logarithm of the exposure of each picture.
    pub scale: Vec<f64>,
    /// Mass fraction of gland above that of the model.
    pub gland: f64,
    /// Contrast of grains above that of the model (relative).
    pub contrast: f64,
    /// Image chain.
    pub chain: Chain,
}

/// What may be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Free {
    /// Exposure of a picture.
    Scale(usize),
    /// Glandularity.
    Gland,
    /// Contrast of grains.
    Contrast,
    /// Amplitude of an effect, by its place in the library.
    Effect(usize),
}

impl Free {
    fn of(self, parameters: &mut Parameters) -> &mut f64 {
        match self {
            Self::Scale(n) => &mut parameters.scale[n],
            Self::Gland => &mut parameters.gland,
            Self::Contrast => &mut parameters.contrast,
            Self::Effect(n) => (IMAGE_EFFECTS[n].of)(&mut parameters.chain),
        }
    }

    fn step(self) -> f64 {
        match self {
            Self::Scale(_) | Self::Contrast => 0.01,
            Self::Gland => 0.02,
            Self::Effect(n) => IMAGE_EFFECTS[n].small,
        }
    }
}

/// Exposures with their errors.
pub struct Exposures {
    /// Objects, in their order.
    pub objects: Vec<Object>,
    factors: Vec<Cholesky<f64, Dyn>>,
}

impl Exposures {
    /// Weighs objects by the error budget.
    ///
    /// # Errors
    /// When a covariance has no factor.
    pub fn new(objects: Vec<Object>) -> Result<Self, ChainError> {
        let factor = |object: &Object| covariance(object).cholesky().ok_or(ChainError::Covariance);
        let factors: Result<_, _> = objects.iter().map(factor).collect();
        Ok(Self { factors: factors?, objects })
    }

    /// Nothing fitted, nothing added.
    pub fn start(&self) -> Parameters {
        let scale = vec![0.0; self.objects.len()];
        Parameters { scale, gland: 0.0, contrast: 0.0, chain: Chain::default() }
    }

    /// What is fitted in any case.
    pub fn nuisances(&self) -> Vec<Free> {
        let mut free = self.scales();
        free.extend([Free::Gland, Free::Contrast]);
        free
    }

    /// Exposures of the pictures.
    pub fn scales(&self) -> Vec<Free> {
        let picture = |n: &usize| matches!(self.objects[*n], Object::Field(..));
        (0..self.objects.len()).filter(picture).map(Free::Scale).collect()
    }

    /// What the image model says of one object.
    ///
    /// # Errors
    /// None with the tables of this program.
    pub fn predicted(&self, n: usize, parameters: &Parameters) -> Result<Vec<f64>, ChainError> {
        Ok(match &self.objects[n] {
            Object::Field(field, composition) => {
                let more = if *composition == Composition::Fitted { parameters.gland } else { 0.0 };
                let scale = parameters.scale[n];
                let signal = field.signal(&parameters.chain, more)?;
                signal.into_iter().map(|s| s.max(1e-12).ln() + scale).collect()
            }
            Object::Grains(grains) => {
                let contrast = grains.contrast(&grains.signal(&parameters.chain, QUANTA));
                contrast.into_iter().map(|c| c * (1.0 + parameters.contrast)).collect()
            }
            Object::Doses(wedges) => {
                wedges.iter().map(|w| (1.0 + parameters.chain.agd_wedge * w).ln()).collect()
            }
        })
    }

    /// Measured less predicted, in standard deviations that are independent of each other.
    ///
    /// # Errors
    /// As [`Self::predicted`].
    pub fn residual(
        &self,
        measured: &[Vec<f64>],
        parameters: &Parameters,
    ) -> Result<DVector<f64>, ChainError> {
        let mut all = Vec::new();
        for n in 0..self.objects.len() {
            let predicted = self.predicted(n, parameters)?;
            let off = measured[n].iter().zip(predicted).map(|(m, p)| m - p);
            all.extend(self.whiten(n, DVector::from_iterator(measured[n].len(), off)).iter());
        }
        Ok(DVector::from_vec(all))
    }

    /// Changes of the residual by what is free, as columns.
    ///
    /// # Errors
    /// As [`Self::predicted`].
    pub fn jacobian(
        &self,
        parameters: &Parameters,
        free: &[Free],
    ) -> Result<DMatrix<f64>, ChainError> {
        let zero: Vec<Vec<f64>> =
            (0..self.objects.len()).map(|n| vec![0.0; self.length(n)]).collect();
        let mut columns = Vec::new();
        for &one in free {
            let (mut more, mut less) = (parameters.clone(), parameters.clone());
            let step = one.step();
            *one.of(&mut more) += step;
            let back = match one {
                // A blur or a share may not be negative.
                Free::Effect(_) => 0.0,
                _ => step,
            };
            *one.of(&mut less) -= back;
            let change = self.residual(&zero, &less)? - self.residual(&zero, &more)?;
            columns.push(change / (step + back));
        }
        Ok(DMatrix::from_columns(&columns))
    }

    /// Least squares by Gauss and Newton; amplitudes stay in their ranges, and a step that does not lower
    /// the misfit is halved. Gives parameters, residual and standard deviations of what is free.
    ///
    /// # Errors
    /// As [`Self::predicted`].
    pub fn fit(
        &self,
        measured: &[Vec<f64>],
        start: &Parameters,
        free: &[Free],
    ) -> Result<(Parameters, DVector<f64>, Vec<f64>), ChainError> {
        let mut found = start.clone();
        let mut residual = self.residual(measured, &found)?;
        let mut errors = vec![0.0; free.len()];
        for _ in 0..STEPS {
            let jacobian = self.jacobian(&found, free)?;
            let normal = jacobian.transpose() * &jacobian;
            let Some(inverse) = normal.try_inverse() else { break };
            errors = (0..free.len()).map(|n| inverse[(n, n)].sqrt()).collect();
            let mut step = &inverse * jacobian.transpose() * &residual;
            let before = residual.norm_squared();
            let mut fall = 0.0;
            for _ in 0..HALVINGS {
                let mut tried = found.clone();
                for (&one, &more) in free.iter().zip(step.iter()) {
                    let value = one.of(&mut tried);
                    *value += more;
                    if let Free::Effect(k) = one {
                        let [low, high] = IMAGE_EFFECTS[k].range;
                        *value = value.clamp(low, high);
                    }
                }
                let left = self.residual(measured, &tried)?;
                fall = before - left.norm_squared();
                if fall > 0.0 {
                    (found, residual) = (tried, left);
                    break;
                }
                step *= 0.5;
            }
            if fall < SETTLED {
                break;
            }
        }
        Ok((found, residual, errors))
    }

    /// Number of values of an object.
    pub fn length(&self, n: usize) -> usize {
        self.factors[n].l_dirty().nrows()
    }

    /// Rows of each object in a residual.
    pub fn rows(&self) -> Vec<std::ops::Range<usize>> {
        let mut first = 0;
        let range = |n| {
            let range = first..first + self.length(n);
            first = range.end;
            range
        };
        (0..self.objects.len()).map(range).collect()
    }

    /// Smooth shapes of each picture and all values of other objects, whitened, as columns: where
    /// something that no effect explains would be seen.
    pub fn smooth(&self) -> DMatrix<f64> {
        let total = (0..self.objects.len()).map(|n| self.length(n)).sum();
        let mut columns = Vec::new();
        for (n, rows) in self.rows().into_iter().enumerate() {
            let mut shapes: Vec<DVector<f64>> = Vec::new();
            match &self.objects[n] {
                Object::Field(field, _) => {
                    for (i, j) in (0..=3i32).flat_map(|i| (0..=3 - i).map(move |j| (i, j))) {
                        let shape =
                            |at: &[f64; 2]| (at[0] / 100.0).powi(i) * (at[1] / 60.0 - 1.0).powi(j);
                        let values = field.centers.iter().map(shape);
                        shapes.push(DVector::from_iterator(rows.len(), values));
                    }
                }
                _ => shapes.extend((0..rows.len()).map(|k| {
                    let mut one = DVector::zeros(rows.len());
                    one[k] = 1.0;
                    one
                })),
            }
            for shape in shapes {
                let mut column = DVector::zeros(total);
                column.rows_mut(rows.start, rows.len()).copy_from(&self.whiten(n, shape));
                columns.push(column);
            }
        }
        DMatrix::from_columns(&columns)
    }

    fn whiten(&self, n: usize, values: DVector<f64>) -> DVector<f64> {
        let lower = self.factors[n].l_dirty();
        let mut solved = values;
        lower.solve_lower_triangular_mut(&mut solved);
        solved
    }
}

/// Covariance of the errors of an object's values.
fn covariance(object: &Object) -> DMatrix<f64> {
    match object {
        Object::Field(field, _) => {
            let at = &field.centers;
            DMatrix::from_fn(at.len(), at.len(), |i, j| {
                let apart = (at[i][0] - at[j][0]).hypot(at[i][1] - at[j][1]);
                let t = 3f64.sqrt() * apart / UNEVEN_LENGTH_MM;
                let own = if i == j { CELL * CELL } else { 0.0 };
                UNEVEN * UNEVEN * (1.0 + t) * (-t).exp() + own
            })
        }
        Object::Grains(grains) => {
            DMatrix::from_diagonal(&DVector::from_vec(grains.variance(QUANTA)))
        }
        Object::Doses(wedges) => {
            DMatrix::from_diagonal_element(wedges.len(), wedges.len(), DOSE * DOSE)
        }
    }
}
