//! A focused linear anti-scatter grid, by its strips.

use crate::xray::{
    attenuation::{AttenuationError, Material},
    transport::media::CUTOFF_KEV,
};
use mammotwin_data::Vec3;

/// Phases of a strip under a ray that are averaged: the grid moves during the exposure.
const PHASES: usize = 64;
/// Steps of the lateral shift, in strip periods per step.
const SHIFTS: usize = 40;
/// Shifts of more periods than this are alike.
const FARTHEST: f64 = 10.0;
/// Energies of the table (keV).
const ENERGIES: usize = 46;

/// What a grid is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct GridPlan {
    /// Height of the interspace over its width.
    pub ratio: f64,
    /// Strips per mm.
    pub lines_per_mm: f64,
    /// Thickness (mm) of a lead strip.
    pub strip_mm: f64,
    /// What is between the strips.
    pub interspace: Material,
    /// Focus (mm): the strips point to it; they run away from the chest wall (along y).
    pub focus: Vec3,
}

impl GridPlan {
    /// 5 : 1, 31 lines per cm, as mammography units have; strips of 20 µm. The fibre between them
    /// is taken as PMMA of 0.5 g/cm³: its make was not found.
    pub fn linear(focus: Vec3) -> Result<Self, AttenuationError> {
        let interspace = Material { density_g_per_cm3: 0.5, ..Material::named("pmma")? };
        Ok(Self { ratio: 5.0, lines_per_mm: 3.1, strip_mm: 0.02, interspace, focus })
    }
}

/// Transmission by direction and energy. Scatter within the grid is not followed.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    focus: Vec3,
    /// Height (mm).
    height: f64,
    /// Strip periods per mm.
    per_mm: f64,
    /// By energy, then shift.
    table: Vec<f64>,
}

impl Grid {
    /// Tabulates a grid.
    pub fn new(plan: &GridPlan) -> Result<Self, AttenuationError> {
        let period = 1.0 / plan.lines_per_mm;
        let height = plan.ratio * (period - plan.strip_mm);
        let lead = Material::named("pb")?;
        let mut table = Vec::with_capacity(ENERGIES * (SHIFTS + 1));
        for n in 0..ENERGIES {
            let energy_kev = CUTOFF_KEV + n as f64;
            let strip = lead.attenuation_per_mm(energy_kev)?;
            let between = plan.interspace.attenuation_per_mm(energy_kev)?;
            for k in 0..=SHIFTS {
                let shift = FARTHEST * (k as f64 / SHIFTS as f64).powi(2) * period;
                table.push(averaged(shift, height, period, plan.strip_mm, strip, between));
            }
        }
        Ok(Self { focus: plan.focus, height, per_mm: plan.lines_per_mm, table })
    }

    /// Share of photons that pass, at the place where they were last, in this direction.
    #[inline]
    pub fn transmission(&self, at: &Vec3, direction: &Vec3, energy_kev: f64) -> f64 {
        // Strips at x lean as the ray from the focus does.
        let lean = (at.x - self.focus.x) / (at.z - self.focus.z);
        let shift = self.height * (direction.x / direction.z - lean).abs() * self.per_mm;
        let place = (shift / FARTHEST).min(1.0).sqrt() * SHIFTS as f64;
        let k = (place as usize).min(SHIFTS - 1);
        let part = place - k as f64;
        let level = (energy_kev - CUTOFF_KEV).clamp(0.0, (ENERGIES - 1) as f64);
        let n = (level as usize).min(ENERGIES - 2);
        let of = |n: usize| {
            let [a, b] = [k, k + 1].map(|k| self.table[n * (SHIFTS + 1) + k]);
            a + part * (b - a)
        };
        let [a, b] = [of(n), of(n + 1)];
        let across = a + (level - n as f64) * (b - a);
        // Along the strips the way is longer by the slant, in lead and between alike.
        let slant = (1.0 + (direction.y / direction.z).powi(2)).sqrt();
        (slant * across.ln()).exp()
    }
}

/// Mean transmission over all phases of a ray that moves by `shift` across strips on its way
/// through the grid.
fn averaged(shift: f64, height: f64, period: f64, strip: f64, lead: f64, between: f64) -> f64 {
    let length = (height * height + shift * shift).sqrt();
    // Strip material left of a place, over one row of strips.
    let covered = |x: f64| {
        let whole = (x / period).floor();
        whole * strip + (x - whole * period).min(strip)
    };
    let one = |n: usize| {
        let start = (n as f64 + 0.5) / PHASES as f64 * period;
        let share = if shift > 0.0 {
            (covered(start + shift) - covered(start)) / shift
        } else {
            f64::from(u8::from(start < strip))
        };
        (-length * (share * lead + (1.0 - share) * between)).exp()
    };
    (0..PHASES).map(one).sum::<f64>() / PHASES as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn primary_passes_and_oblique_photons_do_not() {
        let focus = Vec3::new(0.0, 0.0, 660.0);
        let plan = GridPlan::linear(focus).unwrap();
        let grid = Grid::new(&plan).unwrap();
        for x in [0.0, 40.0, -110.0] {
            let at = Vec3::new(x, 60.0, 20.0);
            let along = (at - focus).normalize();
            let primary = grid.transmission(&at, &along, 20.0);
            // 6.2 % of the area is lead, and fibre takes 4 %.
            assert!((0.87..0.92).contains(&primary), "{x}: {primary}");
            // Beyond the ratio every straight way crosses a strip.
            let oblique = Vec3::new(0.5, 0.0, -1.0).normalize();
            let crossing = grid.transmission(&at, &oblique, 20.0);
            assert!(crossing < 0.1 * primary, "{x}: {crossing}");
            // Along the strips nothing is stopped but by length.
            let beside = Vec3::new(along.x / -along.z, 0.5, -1.0).normalize();
            let passed = grid.transmission(&at, &beside, 20.0);
            assert!(passed > 0.9 * primary && passed < primary, "{x}: {passed}");
        }
    }

    /// Opaque strips: 1 - (shift + strip) / period passes between them.
    #[test]
    fn opaque_strips_have_their_closed_form() {
        let [period, strip, height] = [0.3, 0.03, 1.5];
        for shift in [0.0, 0.06, 0.15, 0.24] {
            let got = averaged(shift, height, period, strip, 1e6, 0.0);
            let exact = 1.0 - (shift + strip) / period;
            assert!((got - exact).abs() < 1.5 / PHASES as f64, "{shift}: {got} {exact}");
        }
        assert!(averaged(0.28, height, period, strip, 1e6, 0.0) < 1e-9);
    }
}
