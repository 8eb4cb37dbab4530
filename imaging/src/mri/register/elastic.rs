//! A rigid motion together with a smooth change of the chest wall's shape.
//!
//! A surface shows a displacement along its normal alone, and a wall that changes its shape is
//! seen here better than there; a plain rigid fit takes part of the change for a motion. So the
//! displacement of the whole wall is estimated, what is not seen of it from a prior that changes
//! are smooth and small, and the rigid part of the map is taken where it is asked for.
//!
//! Displacements are cubic B-splines whose coefficients are independent and normal; a rigid part
//! beside them has no prior. Within a block the map is linear about the block's centre. The
//! posterior is climbed by Levenberg-Marquardt; how much a correlation weighs against the prior
//! follows from the scatter of the blocks' gradients ([`Sites::information`]).

use super::{
    Changes, RegisterError, change,
    factor::Factor,
    landmarks,
    samples::{Block, Sample, covered},
    similarity::{Part, Placement},
};
use crate::mri::lattice::{Lattice, Support};
use mammotwin_data::{Mat3, Vec3, rigid::RigidTransform, volume::Volume};
use nalgebra::{DMatrix, DVector, Dyn, Matrix3, Matrix6, OMatrix, SMatrix, SVector, U6};
use rayon::prelude::*;

/// Numbers of the rigid part: translation (mm), rotation vector (rad) about the centre.
const RIGID: usize = 6;
/// A step that moves no control point further (mm) is the last.
const ENOUGH_MM: f64 = 0.03;
/// So many places at most serve the uncertainty.
const PLACES: usize = 2000;

/// A smooth displacement of the reference, then a rigid motion.
#[derive(Debug, Clone)]
pub(super) struct Elastic {
    /// From reference to moving, after the displacement.
    motion: RigidTransform,
    /// Pivot of the rotation (mm, reference).
    center: Vec3,
    lattice: Lattice,
    /// Rigid numbers, then three a control point (mm).
    numbers: DVector<f64>,
    deviation_mm: f64,
}

/// What an ascent found.
pub(super) struct Climbed {
    /// Weighted mean of the blocks' correlations.
    pub similarity: f64,
    /// Covered part of the samples, by weight.
    pub overlap: f64,
    pub iterations: usize,
    /// Inverse of the covariance of the numbers, its lower triangle.
    precision: DMatrix<f64>,
}

impl Elastic {
    /// A rigid motion (reference to moving) without a change, over the box from `low` to `high`.
    pub fn rigid(
        motion: &RigidTransform,
        center: Vec3,
        [low, high]: [Vec3; 2],
        changes: &Changes,
    ) -> Self {
        let lattice = Lattice::covering(&low, &high, changes.spacing_mm);
        let numbers = DVector::zeros(RIGID + 3 * lattice.count());
        Self { motion: *motion, center, lattice, numbers, deviation_mm: changes.deviation_mm }
    }

    /// Distance of the control points (mm).
    pub fn spacing_mm(&self) -> f64 {
        self.lattice.spacing_mm()
    }

    fn vector(&self, first: usize) -> Vec3 {
        self.numbers.fixed_rows::<3>(first).into_owned()
    }

    /// Displacement (mm) at a place with this support, and its derivative.
    fn displacement(&self, p: &Vec3, support: &[Support]) -> (Vec3, Mat3) {
        let turn = self.vector(3);
        let mut shift = self.vector(0) + turn.cross(&(p - self.center));
        let mut strain = turn.cross_matrix();
        for near in support {
            let control = self.vector(RIGID + 3 * near.index);
            shift += near.weight * control;
            strain += control * near.slope.transpose();
        }
        (shift, strain)
    }

    /// Where a point of the reference goes.
    fn point(&self, p: &Vec3) -> Vec3 {
        self.motion.point(&(p + self.displacement(p, &self.lattice.at(p)).0))
    }

    /// The rigid motion (moving to reference) that fits the map best over some places (mm,
    /// reference); what it leaves is the change of the chest wall.
    pub fn rigid_part(&self, places: &[Vec3]) -> Result<landmarks::Fit, RegisterError> {
        let pairs: Vec<(Vec3, Vec3)> = places.par_iter().map(|p| (self.point(p), *p)).collect();
        landmarks::fit(&pairs)
    }

    /// Climbs the posterior on a level from where the map is.
    ///
    /// The points that are compared are those that the moving image covers at the start.
    pub fn climb(&mut self, samples: &[Sample], moving: &Volume<f32>, steps: usize) -> Climbed {
        let sites = Sites::of(covered(samples, moving, &self.motion), self, moving);
        let mut here = sites.evaluate(self);
        let mut damping = 1e-4;
        let mut iterations = 0;
        while iterations < steps {
            iterations += 1;
            let mut matrix = here.precision.clone();
            (0..matrix.nrows()).for_each(|n| matrix[(n, n)] *= 1.0 + damping);
            let Some(factor) = Factor::of(matrix) else { break };
            let step = factor.solve(here.gradient.clone());
            let old = self.numbers.clone();
            self.numbers += &step;
            let next = sites.evaluate(self);
            if next.score > here.score {
                here = next;
                damping = (damping * 0.2).max(1e-9);
            } else {
                self.numbers = old;
                damping = (damping * 8.0).max(1e-3);
            }
            if step.rows(RIGID, step.len() - RIGID).amax() < ENOUGH_MM {
                break;
            }
        }
        Climbed {
            similarity: here.similarity,
            overlap: sites.all.iter().map(|site| site.block.weight).sum(),
            iterations,
            precision: here.precision,
        }
    }

    /// Covariance of the rigid part over some places (translation in mm, rotation vector in rad
    /// about the centre), by the curvature of the posterior; `None` when the images leave a motion
    /// open.
    pub fn covariance(&self, climbed: &Climbed, places: &[Vec3]) -> Option<Matrix6<f64>> {
        let mut normal = Matrix6::zeros();
        let mut right = OMatrix::<f64, U6, Dyn>::zeros(self.numbers.len());
        for p in places.iter().step_by(places.len().div_ceil(PLACES).max(1)) {
            let rows = change::rows(&(p - self.center));
            normal += rows.tr_mul(&rows);
            for near in self.lattice.at(p) {
                let mut column = right.fixed_columns_mut::<3>(RIGID + 3 * near.index);
                column += near.weight * rows.transpose();
            }
        }
        let mut part = normal.cholesky()?.solve(&right);
        part.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
        let spread = Factor::of(climbed.precision.clone())?.solve(part.transpose());
        Some((part * spread).fixed_view::<6, 6>(0, 0).into_owned())
    }
}

/// Map of a block: `motion(p + shift + strain (p - center))`.
struct Local {
    motion: RigidTransform,
    center: Vec3,
    shift: Vec3,
    strain: Mat3,
}

impl Placement<12> for Local {
    fn point(&self, p: &Vec3) -> Vec3 {
        self.motion.point(&(p + self.shift + self.strain * (p - self.center)))
    }

    /// By the shift, and by the columns of the strain.
    fn derivative(&self, p: &Vec3, _: &Vec3, slope: &Vec3) -> SVector<f64, 12> {
        let slope = self.motion.rotation.tr_mul(slope);
        let arm = p - self.center;
        let mut d = SVector::<f64, 12>::zeros();
        d.fixed_rows_mut::<3>(0).copy_from(&slope);
        for column in 0..3 {
            d.fixed_rows_mut::<3>(3 + 3 * column).copy_from(&(slope * arm[column]));
        }
        d
    }
}

/// A block, where it is, and how its map changes with some of the numbers.
struct Site {
    block: Block,
    center: Vec3,
    support: Vec<Support>,
    /// Derivative of the twelve numbers of [`Local`] by the rigid ones.
    rigid: SMatrix<f64, 12, RIGID>,
}

impl Site {
    fn of(block: Block, map: &Elastic) -> Self {
        let center = block.points.iter().sum::<Vec3>() / block.points.len() as f64;
        let support = map.lattice.at(&center);
        let mut rigid = SMatrix::<f64, 12, RIGID>::zeros();
        for axis in 0..3 {
            let unit = Vec3::ith(axis, 1.0);
            rigid[(axis, axis)] = 1.0;
            let turned = unit.cross(&(center - map.center));
            rigid.fixed_view_mut::<3, 1>(0, 3 + axis).copy_from(&turned);
            for column in 0..3 {
                let turned = unit.cross(&Vec3::ith(column, 1.0));
                rigid.fixed_view_mut::<3, 1>(3 + 3 * column, 3 + axis).copy_from(&turned);
            }
        }
        Self { block, center, support, rigid }
    }
}

/// How the shift and the three columns of the strain of [`Local`] change with a control point, along each
/// axis alike.
fn factors(near: &Support) -> [f64; 4] {
    [near.weight, near.slope.x, near.slope.y, near.slope.z]
}

/// All blocks of a level.
struct Sites<'a> {
    all: Vec<Site>,
    /// The sites that each control point moves, and which of their supports it is.
    moved: Vec<Vec<(usize, usize)>>,
    moving: &'a Volume<f32>,
    /// Logarithm of the likelihood that a unit of similarity is worth.
    information: f64,
}

/// What a map is worth on a level.
struct State {
    similarity: f64,
    /// Logarithm of the posterior, but for a constant.
    score: f64,
    gradient: DVector<f64>,
    /// Its lower triangle.
    precision: DMatrix<f64>,
}

impl<'a> Sites<'a> {
    fn of(blocks: Vec<Block>, map: &Elastic, moving: &'a Volume<f32>) -> Self {
        let all: Vec<Site> = blocks.into_par_iter().map(|block| Site::of(block, map)).collect();
        let mut moved = vec![Vec::new(); map.lattice.count()];
        for (n, site) in all.iter().enumerate() {
            site.support.iter().enumerate().for_each(|(s, near)| moved[near.index].push((n, s)));
        }
        let mut sites = Self { all, moved, moving, information: 1.0 };
        sites.information = sites.information(&sites.parts(map));
        sites
    }

    /// One result a block: the same bits for any number of threads.
    fn parts(&self, map: &Elastic) -> Vec<Option<Part<12>>> {
        let part = |site: &Site| {
            let (shift, strain) = map.displacement(&site.center, &site.support);
            let local = Local { motion: map.motion, center: site.center, shift, strain };
            Part::of(&site.block, self.moving, &local)
        };
        self.all.par_iter().map(part).collect()
    }

    /// The factor that makes the curvature of the similarity equal to the scatter of the blocks'
    /// gradients by their shifts, as they are for a likelihood. Where blocks contradict each
    /// other, because the chest changes or the images differ, a correlation is worth less.
    fn information(&self, parts: &[Option<Part<12>>]) -> f64 {
        let (mut curvature, mut scatter) = (0.0, 0.0);
        for (site, part) in self.all.iter().zip(parts) {
            let Some(part) = part else { continue };
            let weight = site.block.weight;
            curvature += weight * part.curvature.fixed_view::<3, 3>(0, 0).trace();
            scatter += (weight * part.gradient.fixed_rows::<3>(0)).norm_squared();
        }
        if scatter > 0.0 { curvature / scatter } else { 0.0 }
    }

    fn evaluate(&self, map: &Elastic) -> State {
        let count = map.numbers.len();
        let mut state = State {
            similarity: 0.0,
            score: 0.0,
            gradient: DVector::zeros(count),
            precision: DMatrix::zeros(count, count),
        };
        let parts = self.parts(map);
        for (site, part) in self.all.iter().zip(&parts) {
            let Some(part) = part else { continue };
            state.similarity += site.block.weight * part.correlation;
            let weight = site.block.weight * self.information;
            let bent = weight * part.curvature * site.rigid;
            let slope = weight * part.gradient;
            let mut own = state.gradient.fixed_rows_mut::<RIGID>(0);
            own += site.rigid.tr_mul(&slope);
            let mut own = state.precision.fixed_view_mut::<RIGID, RIGID>(0, 0);
            own += site.rigid.tr_mul(&bent);
            for near in &site.support {
                let at = RIGID + 3 * near.index;
                for (n, factor) in factors(near).into_iter().enumerate() {
                    let mut control = state.gradient.fixed_rows_mut::<3>(at);
                    control += factor * slope.fixed_rows::<3>(3 * n);
                    let mut control = state.precision.fixed_view_mut::<3, RIGID>(at, 0);
                    control += factor * bent.fixed_rows::<3>(3 * n);
                }
            }
        }
        // Three columns a control point, each by one thread: the same bits for any number of threads.
        let columns = state.precision.as_mut_slice()[RIGID * count..].par_chunks_mut(3 * count);
        columns.enumerate().for_each(|(control, columns)| self.control(control, &parts, columns));
        let stiffness = map.deviation_mm.powi(-2);
        state.score = self.information * state.similarity;
        for n in RIGID..count {
            let number = map.numbers[n];
            state.score -= 0.5 * stiffness * number * number;
            state.gradient[n] -= stiffness * number;
            state.precision[(n, n)] += stiffness;
        }
        state
    }

    /// The precision's columns of a control point, from its own rows on.
    fn control(&self, control: usize, parts: &[Option<Part<12>>], columns: &mut [f64]) {
        let count = columns.len() / 3;
        for &(n, s) in &self.moved[control] {
            let (site, Some(part)) = (&self.all[n], &parts[n]) else { continue };
            let weight = site.block.weight * self.information;
            let own = factors(&site.support[s]).map(|factor| weight * factor);
            let bent: [Matrix3<f64>; 4] = std::array::from_fn(|row| {
                let of = |column: usize| {
                    own[column] * part.curvature.fixed_view::<3, 3>(3 * row, 3 * column)
                };
                of(0) + of(1) + of(2) + of(3)
            });
            for other in site.support.iter().filter(|other| other.index >= control) {
                let at = RIGID + 3 * other.index;
                let [a, b, c, d] = factors(other);
                let block = a * bent[0] + b * bent[1] + c * bent[2] + d * bent[3];
                for axis in 0..3 {
                    let rows = &mut columns[axis * count + at..][..3];
                    rows.iter_mut().zip(block.column(axis).iter()).for_each(|(to, by)| *to += by);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::volume::Grid;

    fn wave(p: &Vec3) -> f64 {
        (0.21 * p.x + 0.05 * p.z).sin() * (0.17 * p.y).cos() + (0.19 * p.z - 0.1 * p.x).cos()
    }

    fn map(deviation_mm: f64) -> Elastic {
        let changes = Changes { spacing_mm: 40.0, deviation_mm, ..Changes::default() };
        let motion = RigidTransform::about(
            &Vec3::zeros(),
            &Vec3::new(0.02, -0.01, 0.03),
            &Vec3::new(0.6, -0.4, 0.5),
        );
        let corners = [Vec3::repeat(-30.0), Vec3::repeat(30.0)];
        let mut map = Elastic::rigid(&motion, Vec3::new(1.0, 2.0, 3.0), corners, &changes);
        for n in 0..map.numbers.len() {
            let scale = if (3..6).contains(&n) { 0.01 } else { 0.5 };
            map.numbers[n] = scale * (1.7 * n as f64).sin();
        }
        map
    }

    fn moving() -> Volume<f32> {
        let grid = Grid::aligned([41, 41, 41], [2.0; 3], Vec3::repeat(-40.0));
        let values = (0..grid.len()).map(|n| (50.0 * wave(&grid.center(grid.voxel(n)))) as f32);
        Volume { values: values.collect(), grid }
    }

    fn blocks() -> Vec<Block> {
        let spot = |n: usize, b: usize| {
            let [n, b] = [n as f64, b as f64];
            let at = Vec3::new(6.1 * n.sin(), 6.3 * (1.7 * n).cos(), 6.9 * (0.37 * n).sin());
            at + 12.0 * Vec3::new((2.1 * b).sin(), (1.3 * b).cos(), (0.7 * b).sin())
        };
        let block = |b: usize| {
            let points: Vec<Vec3> = (0..80).map(|n| spot(n, b)).collect();
            let values = points.iter().map(wave).collect();
            Block::new(points, values, 0.2).unwrap()
        };
        (0..5).map(block).collect()
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        let (map, moving) = (map(2.0), moving());
        let sites = Sites::of(blocks(), &map, &moving);
        let here = sites.evaluate(&map);
        let scale = here.gradient.amax();
        for n in (0..RIGID).chain((RIGID..map.numbers.len()).step_by(17)) {
            let at = |step: f64| {
                let mut other = map.clone();
                other.numbers[n] += step;
                sites.evaluate(&other).score
            };
            let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((slope - here.gradient[n]).abs() < 1e-5 * scale, "{n}: {slope}");
        }
    }

    /// The curvature of each block by its shift and strain, which are linear in the numbers.
    #[test]
    fn the_precision_is_that_of_shifts_and_strains() {
        let (map, moving) = (map(2.0), moving());
        let sites = Sites::of(blocks(), &map, &moving);
        let (count, here) = (map.numbers.len(), sites.evaluate(&map));
        let mut wanted = DMatrix::zeros(count, count);
        for (site, part) in sites.all.iter().zip(sites.parts(&map)) {
            let local = |map: &Elastic| {
                let (shift, strain) = map.displacement(&site.center, &site.support);
                DVector::from_iterator(12, shift.iter().chain(strain.iter()).copied())
            };
            let by = |n: usize| {
                let mut other = map.clone();
                other.numbers[n] += 1.0;
                local(&other) - local(&map)
            };
            let jacobian = DMatrix::from_columns(&(0..count).map(by).collect::<Vec<_>>());
            let curvature = site.block.weight * sites.information * part.unwrap().curvature;
            wanted += jacobian.transpose() * curvature * jacobian;
        }
        (RIGID..count).for_each(|n| wanted[(n, n)] += map.deviation_mm.powi(-2));
        let off = here.precision.lower_triangle() - wanted.lower_triangle();
        assert!(off.amax() < 1e-9 * wanted.amax(), "{} of {}", off.amax(), wanted.amax());
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let (map, moving) = (map(2.0), moving());
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Sites::of(blocks(), &map, &moving).evaluate(&map))
        };
        let (one, three) = (with(1), with(3));
        assert_eq!(one.precision, three.precision);
        assert_eq!(one.gradient, three.gradient);
    }

    #[test]
    fn the_rigid_part_of_a_rigid_map_is_that_map() {
        let mut map = map(2.0);
        map.numbers.fill(0.0);
        let places: Vec<Vec3> = (0..50)
            .map(|n| {
                20.0 * Vec3::new((n as f64).sin(), (2.3 * n as f64).cos(), (0.4 * n as f64).sin())
            })
            .collect();
        let fit = map.rigid_part(&places).unwrap();
        assert!(fit.rms_mm < 1e-12);
        assert!((fit.transform.inverse().rotation - map.motion.rotation).norm() < 1e-12);
    }

    #[test]
    fn what_clear_images_leave_open_is_as_uncertain_as_the_prior() {
        let moving = moving();
        let blocks = blocks();
        let beyond = Vec3::new(25.0, 0.0, 0.0);
        let places: Vec<Vec3> =
            blocks.iter().flat_map(|block| block.points.iter().map(|p| p + beyond)).collect();
        let spread = |deviation_mm: f64| {
            let map = map(deviation_mm);
            let mut sites = Sites::of(blocks.clone(), &map, &moving);
            sites.information = 1e6;
            let precision = sites.evaluate(&map).precision;
            let climbed = Climbed { similarity: 0.0, overlap: 1.0, iterations: 0, precision };
            let found = map.covariance(&climbed, &places).unwrap();
            found.fixed_view::<3, 3>(0, 0).trace().sqrt()
        };
        let (stiff, soft) = (spread(0.01), spread(2.0));
        println!("{stiff:.3} mm, {soft:.3} mm");
        assert!(stiff > 0.0 && soft > 4.0 * stiff && soft < 10.0, "{stiff} {soft}");
    }
}
