//! Tissue as ten-node tetrahedra: slower and more accurate than the linear ones.
//!
//! Displacement alone, quadratic between corners and edge nodes; edges may be curved. The strain of
//! a straight element is linear, so that it hardly locks even at a Poisson's ratio of 0.499.

use super::solid::{self, Point};
use super::{At, Block, Order, Term};
use crate::materials::{InvariantEnergy, Law, Material, MaterialError};
use crate::mesh::quadratic::{QuadraticMesh, TET_EDGES, shapes, slopes};
use crate::model::ModelError;
use mammotwin_data::{Mat3, Vec3, solution::Solution};
use nalgebra::Vector4;

/// Quadrature of a tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Four points, exact for quadratic functions: as most codes.
    Four,
    /// Fourteen points, exact for functions of fifth order (Walkington 2000).
    Fourteen,
}

impl Rule {
    /// Weights, which sum to one, and barycentric coordinates.
    fn points(self) -> Vec<(f64, Vector4<f64>)> {
        let corners = |weight: f64, b: f64| {
            (0..4).map(move |n| {
                let mut at = Vector4::repeat(b);
                at[n] = 1.0 - 3.0 * b;
                (weight, at)
            })
        };
        match self {
            Self::Four => corners(0.25, 0.138_196_601_125_010_5).collect(),
            Self::Fourteen => {
                let near = corners(0.073_493_043_116_361_95, 0.092_735_250_310_891_23);
                let faces = corners(0.112_687_925_718_015_85, 0.310_885_919_263_300_6);
                let edges = TET_EDGES.into_iter().map(|[a, b]| {
                    let mut at = Vector4::repeat(0.045_503_704_125_649_65);
                    (at[a], at[b]) = (0.5 - at[a], 0.5 - at[b]);
                    (0.042_546_020_777_081_47, at)
                });
                near.chain(faces).chain(edges).collect()
            }
        }
    }
}

/// A quadrature point of a rest element.
#[derive(Debug, Clone)]
struct Sample {
    /// Rest volume (mm³).
    volume: f64,
    /// Gradients of the shape functions (1/mm).
    gradients: [Vec3; 10],
}

/// The points of an element with its nodes at `x`; `None` when it is turned inside out.
fn samples(x: &[Vec3; 10], rule: Rule) -> Option<Vec<Sample>> {
    let one = |(weight, at): (f64, Vector4<f64>)| {
        let slopes = slopes(&at);
        // Columns: change of place as each coordinate grows at the expense of the first.
        let by = |k: usize| (0..10).map(|n| (slopes[n][k] - slopes[n][0]) * x[n]).sum::<Vec3>();
        let jacobian = Mat3::from_columns(&[by(1), by(2), by(3)]);
        let volume = weight * jacobian.determinant() / 6.0;
        let inverse = jacobian.try_inverse()?.transpose();
        let gradients = slopes.map(|s| inverse * Vec3::new(s[1] - s[0], s[2] - s[0], s[3] - s[0]));
        (volume > 0.0).then_some(Sample { volume, gradients })
    };
    rule.points().into_iter().map(one).collect()
}

/// Tissue as ten-node tetrahedra, one law for each.
#[derive(Debug, Clone)]
pub struct QuadraticBulk {
    name: String,
    tets: Vec<[u32; 10]>,
    laws: Vec<Law>,
    samples: Vec<Vec<Sample>>,
}

impl QuadraticBulk {
    /// Tissue that fills `mesh`, stress-free with the nodes at `mesh.points`.
    ///
    /// # Errors
    /// Another number of laws than tetrahedra, or a tetrahedron that is turned inside out.
    pub fn new(
        name: &str,
        mesh: &QuadraticMesh,
        laws: Vec<Law>,
        rule: Rule,
    ) -> Result<Self, ModelError> {
        let term = || name.to_owned();
        let (wanted, got) = (mesh.tets.len(), laws.len());
        if wanted != got {
            return Err(ModelError::Count { term: term(), what: "laws", wanted, got });
        }
        let one = |(element, tet): (usize, &[u32; 10])| {
            let x = tet.map(|n| mesh.points[n as usize]);
            samples(&x, rule).ok_or_else(|| ModelError::Flat { term: term(), element, size: 0.0 })
        };
        let samples = mesh.tets.iter().enumerate().map(one).collect::<Result<_, _>>()?;
        Ok(Self { name: name.into(), tets: mesh.tets.clone(), laws, samples })
    }

    fn point<'a>(&'a self, element: usize, sample: &'a Sample) -> Point<'a, 10> {
        let law = &self.laws[element];
        Point {
            law,
            volume: sample.volume,
            gradients: &sample.gradients,
            share_kpa: law.volumetric_kpa(),
            pressure_kpa: 0.0,
        }
    }

    fn deformation(&self, element: usize, sample: &Sample, points: &[Vec3]) -> Mat3 {
        let nodes = self.tets[element].iter().zip(&sample.gradients);
        nodes.map(|(&n, gradient)| points[n as usize] * gradient.transpose()).sum()
    }
}

/// Weight (mN) of each node for a body force (mN/mm³) on the rest volume of `mesh`, as the virtual
/// work of the ten shape functions has it: corners of straight elements pull the other way.
///
/// # Errors
/// A tetrahedron that is turned inside out.
pub fn nodal_weights(mesh: &QuadraticMesh, force: Vec3) -> Result<Vec<Vec3>, ModelError> {
    let mut weights = vec![Vec3::zeros(); mesh.points.len()];
    for (element, tet) in mesh.tets.iter().enumerate() {
        let x = tet.map(|n| mesh.points[n as usize]);
        let flat = || ModelError::Flat { term: "weight".into(), element, size: 0.0 };
        let samples = samples(&x, Rule::Fourteen).ok_or_else(flat)?;
        for (sample, (_, at)) in samples.iter().zip(Rule::Fourteen.points()) {
            for (&node, shape) in tet.iter().zip(shapes(&at)) {
                weights[node as usize] += shape * sample.volume * force;
            }
        }
    }
    Ok(weights)
}

impl Term for QuadraticBulk {
    fn name(&self) -> &str {
        &self.name
    }

    fn elements(&self) -> usize {
        self.tets.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.tets[element]
    }

    fn is_internal(&self) -> bool {
        true
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        for sample in &self.samples[element] {
            let f = self.deformation(element, sample, at.points);
            self.point(element, sample).add(&f, order, block)?;
        }
        Ok(())
    }

    fn shift(&self, element: usize, at: &At, block: &mut Block) -> bool {
        for sample in &self.samples[element] {
            let f = self.deformation(element, sample, at.points);
            self.point(element, sample).add_shift(&f, block);
        }
        true
    }

    fn raise_shear(&self, shear_kpa: &mut [f64]) {
        solid::raise_shear(&self.tets, &self.laws, shear_kpa);
    }

    /// Deformation and stress are those of the first quadrature point with the smallest det F.
    fn report(&self, at: &At, solution: &mut Solution) {
        solution.mean_stress_kpa = vec![0.0; at.points.len()];
        let mut weights = vec![0.0; at.points.len()];
        for (element, tet) in self.tets.iter().enumerate() {
            let law = &self.laws[element];
            let all = self.samples[element].iter();
            let all = all.map(|s| (self.deformation(element, s, at.points), s.volume));
            let mut worst = Mat3::repeat(f64::INFINITY);
            let mut mean = Mat3::zeros();
            let mut volume = 0.0;
            for (f, weight) in all {
                let j = f.determinant();
                let stress = law.stress(&f).unwrap_or_else(|_| Mat3::repeat(f64::NAN));
                mean += weight * stress * f.transpose() / j;
                volume += weight;
                if !(worst.determinant() <= j) {
                    worst = f;
                }
            }
            let cauchy = mean / volume;
            for &n in tet {
                solution.mean_stress_kpa[n as usize] += volume * cauchy.trace() / 3.0;
                weights[n as usize] += volume;
            }
            solution.deformation_gradient.push(worst);
            solution.cauchy_kpa.push(cauchy);
        }
        for (pressure, weight) in solution.mean_stress_kpa.iter_mut().zip(weights) {
            *pressure /= f64::max(weight, f64::MIN_POSITIVE);
        }
    }
}
