//! Fibroglandular tissue: lobes that spread from the nipple to the base of the breast.

use super::torso::{BreastFrame, Torso, local, smooth_step};
use mammotwin_data::Vec3;
use mammotwin_imaging::mri::synthesize::noise;

/// Lobes around the axis of a breast.
const LOBES: f64 = 9.0;

/// How far the gland reaches, for a wanted part of the volume.
#[derive(Debug, Clone, Copy, Default)]
pub struct Lobes {
    seed: u64,
    threshold: f64,
}

impl Lobes {
    /// Lobes that fill the person's fibroglandular fraction of the breast, by bisection.
    pub fn fitted(torso: &Torso, seed: u64) -> Self {
        let fraction = torso.person.breast.gland_fraction;
        // Levels of a lattice of places in the right breast, highest first.
        let frame = &torso.breasts[0];
        let breast = &torso.person.breast;
        let steps = |length: f64| (-20..=20).map(move |n| f64::from(n) / 20.0 * length);
        let mut levels = Vec::new();
        for lateral in steps(breast.base_x_mm) {
            for up in steps(breast.base_z_mm) {
                for out in steps(breast.projection_mm) {
                    let p =
                        frame.base + lateral * frame.lateral + up * Vec3::z() + out * frame.outward;
                    let (wall, skin) = (torso.chest_wall(&p), torso.smooth_skin(&p));
                    if wall > 0.0 && skin < 0.0 {
                        levels.push(
                            Self { seed, threshold: 0.0 }.level(torso, frame, &p, wall, skin),
                        );
                    }
                }
            }
        }
        levels.sort_by(|a, b| b.total_cmp(a));
        let wanted = (fraction * levels.len() as f64) as usize;
        let threshold = levels.get(wanted).copied().unwrap_or(f64::INFINITY);
        Self { seed, threshold }
    }

    /// Whether a stress-free place is fibroglandular.
    pub fn contain(
        &self,
        torso: &Torso,
        frame: &BreastFrame,
        p: &Vec3,
        chest_wall: f64,
        skin: f64,
    ) -> bool {
        self.level(torso, frame, p, chest_wall, skin) > self.threshold
    }

    /// Greater means more likely gland.
    fn level(
        &self,
        torso: &Torso,
        frame: &BreastFrame,
        p: &Vec3,
        chest_wall: f64,
        skin: f64,
    ) -> f64 {
        if chest_wall < 3.0 || skin > -2.5 {
            return f64::NEG_INFINITY;
        }
        let breast = &torso.person.breast;
        let [lateral, up, out] = local(frame, p);
        let [u, v] = [lateral / breast.base_x_mm, up / breast.base_z_mm];
        let depth = (1.0 - out / breast.projection_mm).clamp(0.0, 1.2);
        let radius = u.hypot(v);
        if radius > 1.0 {
            return f64::NEG_INFINITY;
        }
        // A cone from the nipple that closes before the muscle.
        let cone = (0.10 + 0.75 * depth) * (1.0 - smooth_step((depth - 0.75) / 0.25));
        let twist = noise::smooth(self.seed ^ 0x91, p, 30.0);
        let petals = 1.0 + 0.3 * (LOBES * v.atan2(u) + 3.0 * twist).sin() * (4.0 * radius).min(1.0);
        let coarse = noise::smooth(self.seed ^ 0x92, p, 12.0);
        let fine = noise::smooth(self.seed ^ 0x93, p, 5.0);
        cone * petals - radius + 0.22 * coarse + 0.12 * fine
    }
}
