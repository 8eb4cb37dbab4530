//! A thin plate that bends between its supports: the elastic paddle (Mîra 2018, § 5.1.1: Lexan, 4 mm,
//! 2250 MPa, ν = 0.4, shell elements).
//!
//! Deflections are those of Kirchhoff's plate, by the method of Ritz: products of Legendre
//! polynomials along and away from the chest-wall edge, times factors that vanish at the supports
//! (Timoshenko and Woinowsky-Krieger, *Theory of plates and shells* (1959), § 80-81). The upright lip
//! along the chest-wall edge is a beam. Stiffness and mass are diagonalised once; the coordinates
//! are the amplitudes of these modes, each of mean square one. Deflections are taken for small: at those of the
//! plate's thickness its middle surface would stretch and stiffen it, which is neglected.

use super::{AT_REST, Bend, COORDINATES, Lift, Place, Pose};
use nalgebra::{Cholesky, DMatrix, SymmetricEigen};

/// Where a plate is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Support {
    /// Both sides and the rear rest on the frame and may turn; the chest-wall edge is free.
    Frame,
    /// All four sides rest and may turn.
    AllSides,
    /// The rear is clamped, everything else is free.
    Rear,
}

/// A rectangular plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheet {
    /// Length of the chest-wall edge (mm).
    pub width_mm: f64,
    /// Length of the sides (mm).
    pub depth_mm: f64,
    /// Thickness (mm).
    pub thickness_mm: f64,
    /// Young's modulus (kPa).
    pub young_kpa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Where it is held.
    pub support: Support,
    /// Height (mm) of the upright lip along the chest-wall edge, as thick as the plate; 0 for none.
    pub lip_mm: f64,
}

impl Sheet {
    /// Flexural rigidity E h³ / 12 (1 - ν²) (mN mm).
    pub fn rigidity(&self) -> f64 {
        self.young_kpa * self.thickness_mm.powi(3) / (12.0 * (1.0 - self.poisson * self.poisson))
    }

    /// Flexural rigidity (mN mm²) of the lip, about its own middle.
    pub fn lip_rigidity(&self) -> f64 {
        self.young_kpa * self.thickness_mm * self.lip_mm.powi(3) / 12.0
    }
}

/// Why there is no such plate.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("elastic paddle: {what} is {value}; {remedy}")]
pub struct PlateError {
    /// Which number.
    pub what: &'static str,
    /// Its value.
    pub value: f64,
    /// What would do.
    pub remedy: &'static str,
}

/// Functions along the chest-wall edge, and away from it.
const ALONG: usize = 5;
const AWAY: usize = 5;
/// Points of the quadrature: exact for all products of these functions.
const POINTS: usize = 12;

/// An elastic plate, ready to be pushed at.
#[derive(Debug, Clone)]
pub struct ElasticPlate {
    sheet: Sheet,
    /// Column by mode: its products of functions.
    modes: DMatrix<f64>,
    /// Of each mode (mN/mm).
    stiffness: Pose,
}

impl ElasticPlate {
    /// Finds the modes of a plate.
    ///
    /// # Errors
    /// A size or modulus that is not positive, or a Poisson ratio outside of 0 to 0.5.
    pub fn new(sheet: Sheet) -> Result<Self, PlateError> {
        for (what, value) in [
            ("width (mm)", sheet.width_mm),
            ("depth (mm)", sheet.depth_mm),
            ("thickness (mm)", sheet.thickness_mm),
            ("Young's modulus (kPa)", sheet.young_kpa),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(PlateError { what, value, remedy: "give a positive one" });
            }
        }
        let ratio = sheet.poisson;
        if !(0.0..0.5).contains(&ratio) {
            let remedy = "give one from 0 to below 0.5";
            return Err(PlateError { what: "Poisson's ratio", value: ratio, remedy });
        }
        if !(sheet.lip_mm >= 0.0 && sheet.lip_mm.is_finite()) {
            let (what, remedy) = ("height of the lip (mm)", "give one that is not negative");
            return Err(PlateError { what, value: sheet.lip_mm, remedy });
        }
        let (stiffness, mass) = matrices(&sheet);
        let none = PlateError {
            what: "thickness (mm)",
            value: sheet.thickness_mm,
            remedy: "give another: the plate's modes cannot be told apart",
        };
        // K a = λ M a as a symmetric problem in Lᵀ a, with M = L Lᵀ.
        let lower = Cholesky::new(mass).ok_or(none)?.l();
        let inverse = lower.try_inverse().ok_or(none)?;
        let symmetric = &inverse * stiffness * inverse.transpose();
        let found = SymmetricEigen::new(0.5 * (&symmetric + symmetric.transpose()));
        let area = sheet.width_mm * sheet.depth_mm;
        let mut stiffness = AT_REST;
        for (value, one) in stiffness.iter_mut().zip(found.eigenvalues.iter()) {
            *value = one * area;
        }
        if !stiffness.iter().all(|value| *value > 0.0 && value.is_finite()) {
            return Err(none);
        }
        let modes = inverse.transpose() * found.eigenvectors * area.sqrt();
        Ok(Self { sheet, modes, stiffness })
    }

    /// The plate.
    pub fn sheet(&self) -> &Sheet {
        &self.sheet
    }

    /// Pose under forces (mN) along the coordinates.
    pub fn pose_under(&self, forces: &Pose) -> Pose {
        let mut pose = AT_REST;
        for n in 0..COORDINATES {
            pose[n] = forces[n] / self.stiffness[n];
        }
        pose
    }
}

impl Lift for ElasticPlate {
    fn coordinates(&self) -> usize {
        COORDINATES
    }

    fn bend(&self, place: Place, pose: &Pose) -> Bend {
        let functions = functions(&self.sheet, place);
        let mut bend = Bend::default();
        for (n, [value, u, v, uu, uv, vv]) in functions.into_iter().enumerate() {
            let share: f64 = (0..COORDINATES).map(|k| self.modes[(n, k)] * pose[k]).sum();
            bend.value += share * value;
            bend.slope[0] += share * u;
            bend.slope[1] += share * v;
            bend.curvature[0] += share * uu;
            bend.curvature[1] += share * uv;
            bend.curvature[2] += share * vv;
        }
        bend
    }

    fn weights(&self, place: Place) -> Pose {
        let functions = functions(&self.sheet, place);
        let mut weights = AT_REST;
        for (k, weight) in weights.iter_mut().enumerate() {
            *weight = functions.iter().enumerate().map(|(n, f)| self.modes[(n, k)] * f[0]).sum();
        }
        weights
    }

    fn resistance(&self, pose: &Pose) -> (Pose, Pose) {
        let mut force = AT_REST;
        for n in 0..COORDINATES {
            force[n] = self.stiffness[n] * pose[n];
        }
        (force, self.stiffness)
    }
}

/// Value, first and second derivative.
type Jet = [f64; 3];

fn product([a, da, dda]: Jet, [b, db, ddb]: Jet) -> Jet {
    [a * b, da * b + a * db, dda * b + 2.0 * da * db + a * ddb]
}

/// Legendre polynomials at `x`, with their derivatives.
fn legendre<const N: usize>(x: f64) -> [Jet; N] {
    let mut jets = [[1.0, 0.0, 0.0]; N];
    if N > 1 {
        jets[1] = [x, 1.0, 0.0];
    }
    for n in 2..N {
        let (a, b) = (jets[n - 1], jets[n - 2]);
        let m = n as f64;
        let [value, slope, curve] = product([x, 1.0, 0.0], a);
        let next = |up: f64, down: f64| ((2.0 * m - 1.0) * up - (m - 1.0) * down) / m;
        jets[n] = [next(value, b[0]), next(slope, b[1]), next(curve, b[2])];
    }
    jets
}

/// Value and derivatives (u, v, uu, uv, vv; 1/mm, 1/mm²) of all products of functions at a place.
/// Beyond its ends the plate is level, as high as where it ends: derivatives across them are zero there.
fn functions(sheet: &Sheet, [along, away]: Place) -> [[f64; 6]; COORDINATES] {
    let [x, y] = [2.0 * along / sheet.width_mm, away / sheet.depth_mm];
    let within = |value: f64, low: f64, high: f64| {
        let inside = if (low..=high).contains(&value) { 1.0 } else { 0.0 };
        (value.clamp(low, high), inside)
    };
    let ((x, goes_x), (y, goes_y)) = (within(x, -1.0, 1.0), within(y, -0.1, 1.0));
    let (sides, ends): (Jet, Jet) = match sheet.support {
        Support::Frame => ([1.0 - x * x, -2.0 * x, -2.0], [1.0 - y, -1.0, 0.0]),
        Support::AllSides => ([1.0 - x * x, -2.0 * x, -2.0], [y * (1.0 - y), 1.0 - 2.0 * y, -2.0]),
        Support::Rear => ([1.0, 0.0, 0.0], [(1.0 - y).powi(2), 2.0 * (y - 1.0), 2.0]),
    };
    let (dx, dy) = (goes_x * 2.0 / sheet.width_mm, goes_y / sheet.depth_mm);
    let across: [Jet; ALONG] = legendre(x);
    let beyond: [Jet; AWAY] = legendre(2.0 * y - 1.0);
    let mut all = [[0.0; 6]; COORDINATES];
    for (i, f) in across.into_iter().enumerate() {
        let [f, df, ddf] = product(sides, f);
        for (j, [g, dg, ddg]) in beyond.into_iter().enumerate() {
            let [g, dg, ddg] = product(ends, [g, 2.0 * dg, 4.0 * ddg]);
            all[i * AWAY + j] = [
                f * g,
                df * dx * g,
                f * dg * dy,
                ddf * dx * dx * g,
                df * dx * dg * dy,
                f * ddg * dy * dy,
            ];
        }
    }
    all
}

/// Stiffness (mN/mm) and mass (mm²) of the products of functions.
fn matrices(sheet: &Sheet) -> (DMatrix<f64>, DMatrix<f64>) {
    let mut stiffness = DMatrix::zeros(COORDINATES, COORDINATES);
    let mut mass = DMatrix::zeros(COORDINATES, COORDINATES);
    let (rigidity, ratio) = (sheet.rigidity(), sheet.poisson);
    let rule = gauss();
    for (x, wx) in rule {
        let along = 0.5 * sheet.width_mm * x;
        for (y, wy) in rule {
            let away = 0.5 * sheet.depth_mm * (1.0 + y);
            let area = 0.25 * sheet.width_mm * sheet.depth_mm * wx * wy;
            let all = functions(sheet, [along, away]);
            for (a, f) in all.iter().enumerate() {
                for (b, g) in all.iter().enumerate() {
                    let mixed = f[3] * g[5] + f[5] * g[3];
                    let bending = f[3] * g[3] + f[5] * g[5] + ratio * mixed;
                    let twisting = 2.0 * (1.0 - ratio) * f[4] * g[4];
                    stiffness[(a, b)] += area * rigidity * (bending + twisting);
                    mass[(a, b)] += area * f[0] * g[0];
                }
            }
        }
        let length = 0.5 * sheet.width_mm * wx;
        let edge = functions(sheet, [along, 0.0]);
        for (a, f) in edge.iter().enumerate() {
            for (b, g) in edge.iter().enumerate() {
                stiffness[(a, b)] += length * sheet.lip_rigidity() * f[3] * g[3];
            }
        }
    }
    (stiffness, mass)
}

/// Gauss' places in -1..1 and their weights, by Newton's method on the Legendre polynomial.
fn gauss() -> [(f64, f64); POINTS] {
    let mut rule = [(0.0, 0.0); POINTS];
    for (n, point) in rule.iter_mut().enumerate() {
        let mut x = (std::f64::consts::PI * (n as f64 + 0.75) / (POINTS as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..20 {
            let [value, first, _] = legendre::<{ POINTS + 1 }>(x)[POINTS];
            (x, slope) = (x - value / first, first);
        }
        *point = (x, 2.0 / ((1.0 - x * x) * slope * slope));
    }
    rule
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lexan(support: Support) -> Sheet {
        Sheet {
            width_mm: 240.0,
            depth_mm: 240.0,
            thickness_mm: 4.0,
            young_kpa: 2.25e6,
            poisson: 0.3,
            support,
            lip_mm: 0.0,
        }
    }

    /// Deflection (mm) at `at` under a pressure (kPa) everywhere.
    fn under_pressure(plate: &ElasticPlate, kpa: f64, at: Place) -> f64 {
        let Sheet { width_mm, depth_mm, .. } = plate.sheet;
        let mut forces = AT_REST;
        for (x, wx) in gauss() {
            for (y, wy) in gauss() {
                let place = [0.5 * width_mm * x, 0.5 * depth_mm * (1.0 + y)];
                let share = 0.25 * width_mm * depth_mm * wx * wy * kpa;
                for (force, weight) in forces.iter_mut().zip(plate.weights(place)) {
                    *force += share * weight;
                }
            }
        }
        plate.bend(at, &plate.pose_under(&forces)).value
    }

    /// Verifies: square plate on four sides, even load | Timoshenko & Woinowsky-Krieger 1959, table 8 | 0.5 %
    /// Verifies: square plate on four sides, point load | the same, table 23 | 5 %
    /// Verifies: square plate with a free side | the same, table 48 | 1 %
    #[test]
    fn simply_supported_plates_bend_as_tables_say() {
        // Timoshenko and Woinowsky-Krieger 1959, tables 8, 23 and 48: square plates, ν = 0.3.
        let sheet = lexan(Support::AllSides);
        let plate = ElasticPlate::new(sheet).unwrap();
        let (d, a) = (sheet.rigidity(), sheet.width_mm);
        let got = under_pressure(&plate, 1.0, [0.0, 0.5 * a]) * d / a.powi(4);
        assert!((got / 0.00406 - 1.0).abs() < 0.005, "all sides: {got}");

        let weights = plate.weights([0.0, 0.5 * a]);
        let got = plate.bend([0.0, 0.5 * a], &plate.pose_under(&weights)).value * d / (a * a);
        // Bending is singular under a point load: these functions are 4 % stiff there, 1 % at a free edge.
        assert!(got < 0.01160 && got > 0.0110, "point load: {got}");

        let sheet = lexan(Support::Frame);
        let plate = ElasticPlate::new(sheet).unwrap();
        let got = under_pressure(&plate, 1.0, [0.0, 0.0]) * d / a.powi(4);
        assert!((got / 0.01286 - 1.0).abs() < 0.01, "a free side: {got}");
    }

    /// Verifies: clamped plate, ν = 0 | P L³ / 3 E I | 1e-6
    #[test]
    fn a_clamped_plate_without_lateral_contraction_is_a_cantilever() {
        let sheet = Sheet { poisson: 0.0, ..lexan(Support::Rear) };
        let plate = ElasticPlate::new(sheet).unwrap();
        let Sheet { width_mm, depth_mm, .. } = sheet;
        let mut forces = AT_REST;
        for (x, wx) in gauss() {
            // 100 N along the free edge.
            let weights = plate.weights([0.5 * width_mm * x, 0.0]);
            forces.iter_mut().zip(weights).for_each(|(f, w)| *f += 0.5 * wx * 1e5 * w);
        }
        let pose = plate.pose_under(&forces);
        let want = 1e5 * depth_mm.powi(3) / (3.0 * sheet.rigidity() * width_mm);
        for along in [-100.0, 0.0, 70.0] {
            let got = plate.bend([along, 0.0], &pose).value;
            assert!((got / want - 1.0).abs() < 1e-6, "{got} for {want}");
        }
    }

    /// Verifies: lip of a plate alone | P L³ / 48 E I | 2 %
    #[test]
    fn a_lip_without_a_plate_is_a_beam() {
        let sheet = Sheet { lip_mm: 4000.0, ..lexan(Support::Frame) };
        let plate = ElasticPlate::new(sheet).unwrap();
        let weights = plate.weights([0.0, 0.0]);
        let got = plate.bend([0.0, 0.0], &plate.pose_under(&weights)).value;
        let want = sheet.width_mm.powi(3) / (48.0 * sheet.lip_rigidity());
        assert!((got / want - 1.0).abs() < 0.02, "{got} for {want}");
    }

    #[test]
    fn bends_have_the_derivatives_they_claim() {
        let mut pose = AT_REST;
        pose.iter_mut().enumerate().for_each(|(n, q)| *q = ((7 * n + 3) % 5) as f64 - 2.0);
        let curved =
            super::super::CurvedPlate { rise_mm: 12.0, reach_mm: 60.0, arch_radius_mm: 600.0 };
        let gimbal = super::super::Gimbal { axis_mm: 60.0, tilt_mn_mm: 1.0, roll_mn_mm: 1.0 };
        let mut lifts: Vec<Box<dyn Lift>> = vec![Box::new(curved), Box::new(gimbal)];
        for support in [Support::Frame, Support::AllSides, Support::Rear] {
            lifts.push(Box::new(ElasticPlate::new(lexan(support)).unwrap()));
        }
        let h = 1e-4;
        for lift in &lifts {
            // On the plate; beside it, behind its rear, before its edge, beyond a corner.
            let beyond = [[-150.0, 60.0], [40.0, 260.0], [20.0, -40.0], [150.0, 270.0]];
            for [u, v] in [[13.0, 20.0], [-70.0, 110.0], [0.0, -4.0]].into_iter().chain(beyond) {
                let at = |du: f64, dv: f64| lift.bend([u + du, v + dv], &pose);
                let here = at(0.0, 0.0);
                let (right, left) = (at(h, 0.0), at(-h, 0.0));
                let (up, down) = (at(0.0, h), at(0.0, -h));
                let near = |a: f64, b: f64, c: f64| {
                    let slope = (a - b) / (2.0 * h);
                    assert!((slope - c).abs() < 1e-6 * (1.0 + c.abs()), "{lift:?}: {slope} {c}");
                };
                near(right.value, left.value, here.slope[0]);
                near(up.value, down.value, here.slope[1]);
                near(right.slope[0], left.slope[0], here.curvature[0]);
                near(up.slope[0], down.slope[0], here.curvature[1]);
                near(up.slope[1], down.slope[1], here.curvature[2]);
                for (k, weight) in lift.weights([u, v]).into_iter().enumerate() {
                    let mut more = pose;
                    more[k] += 1.0;
                    let change = lift.bend([u, v], &more).value - here.value;
                    assert!((change - weight).abs() < 1e-9 * (1.0 + here.value.abs()));
                }
            }
        }
    }
}
