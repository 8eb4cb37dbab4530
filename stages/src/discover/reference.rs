//! What an error of the reference pose's skin does to all poses.
//!
//! The model begins with the measured reference pose: where its skin lies too far out, the breast is
//! thicker than it is, hangs farther, and this error grows with the deformation. How much it grows is
//! measured by evaluating the model from reference poses with known errors.

use super::observe::residual;
use crate::{
    calibrate::{Experiment, Fit},
    mesh::BreastMesh,
    model::Body,
    shape::Shape,
};
use mammotwin_data::{Failure, Vec3, mesh::Patch};
use mammotwin_solver::{
    distance::SurfaceIndex,
    terms::{GridDistance, Target},
};
use nalgebra::DVector;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Known errors: how many, their size and length (mm).
const COUNT: u64 = 6;
const SIZE_MM: f64 = 0.25;
const LENGTH_MM: f64 = 12.0;
/// Waves of one error.
const WAVES: usize = 200;
/// Length (mm) over which the growth is averaged.
const AVERAGE_MM: f64 = 30.0;
/// Fewer evaluations than this are no measure of the growth.
const FEWEST: usize = 2;

/// A smooth random field with the correlation exp(-d²/2L²), by random waves.
struct Field(Vec<(Vec3, f64)>);

impl Field {
    fn drawn(random: &mut ChaCha8Rng) -> Self {
        let wave = |_| {
            let along = Vec3::from_fn(|_, _| {
                let normal: f64 = StandardNormal.sample(random);
                normal / LENGTH_MM
            });
            (along, random.random_range(0.0..TAU))
        };
        Self((0..WAVES).map(wave).collect())
    }

    fn at(&self, p: &Vec3) -> f64 {
        let sum: f64 = self.0.iter().map(|(along, phase)| (along.dot(p) + phase).cos()).sum();
        SIZE_MM * sum * (2.0 / WAVES as f64).sqrt()
    }
}

/// The mesh with its skin off by a field, along its normals; the chest wall stays.
fn moved(mesh: &BreastMesh, field: &Field) -> Result<BreastMesh, Failure> {
    let wrong = |cause: &dyn std::fmt::Display| Failure::Numerics(format!("discover: {cause}"));
    let skin = mesh.mesh.patch_surface(Patch::Skin);
    let index = SurfaceIndex::new(&skin).map_err(|c| wrong(&c))?;
    let closest = index.closest_of(&mesh.mesh.points).map_err(|c| wrong(&c))?;
    let wall = GridDistance::new(&mesh.wall);
    let points: Vec<Vec3> = mesh
        .mesh
        .points
        .iter()
        .zip(closest)
        .map(|(p, skin)| {
            let above = wall.distance(p).0.max(0.0);
            let part = above / (above + skin.distance_mm).max(f64::MIN_POSITIVE);
            p + part * field.at(&skin.point) * skin.normal
        })
        .collect();
    let mut moved = mesh.clone();
    moved.quadratic = mesh.quadratic.as_ref().map(|quadratic| quadratic.with_points(&points));
    moved.mesh.points = points;
    Ok(moved)
}

/// By how much (mm per mm) an error of the reference pose grows on its way into the residuals of
/// `base`, an evaluation of `experiment` on `mesh`, at each weighed node of each pose.
///
/// # Errors
/// [`Failure::Numerics`] when the model stands on hardly any reference pose with errors.
pub(super) fn growth(
    mesh: &BreastMesh,
    base: &Fit,
    experiment: &Experiment,
    (weighed, reference): (&[u32], &Shape),
) -> Result<DVector<f64>, Failure> {
    let here = residual(base, weighed);
    let nodes = reference.points.len();
    let one = |seed: u64| {
        let field = Field::drawn(&mut ChaCha8Rng::seed_from_u64(seed));
        let other = moved(mesh, &field)?;
        // The experiment keeps its nodes: those of another one would be chosen anew.
        let body = Body {
            mesh: &other.mesh,
            quadratic: other.quadratic.as_ref(),
            ..experiment.body.clone()
        };
        let Ok(fit) = experiment.evaluate_as(&body, base.moduli, Some(base)) else {
            return Ok(None);
        };
        let error = DVector::from_iterator(nodes, reference.points.iter().map(|p| field.at(p)));
        Ok(Some((error, residual(&fit, weighed) - &here)))
    };
    let found: Vec<_> = (0..COUNT).into_par_iter().map(one).collect::<Result<_, Failure>>()?;
    let found: Vec<(DVector<f64>, DVector<f64>)> = found.into_iter().flatten().collect();
    if found.len() < FEWEST {
        return Err(Failure::Numerics(
            "discover: the model does not stand on reference poses that are off by 0.25 mm".into(),
        ));
    }
    let near = |i: usize, j: usize| {
        let far = (reference.points[i] - reference.points[j]).norm_squared();
        (-0.5 * far / (AVERAGE_MM * AVERAGE_MM)).exp()
    };
    let growth = |row: usize| {
        let at = row / nodes * nodes;
        let (mut there, mut given) = (0.0, 0.0);
        for (error, change) in &found {
            for j in 0..nodes {
                let weight = near(row - at, j);
                there += weight * change[at + j].powi(2);
                given += weight * error[j].powi(2);
            }
        }
        (there / given.max(f64::MIN_POSITIVE)).sqrt()
    };
    Ok(DVector::from_fn(here.len(), |row, _| growth(row)))
}
