//! The whole course in time: the plates close, are held, and open again.

use super::{ElasticCurve, Memory, Relaxation};

/// What is held while the breast is clamped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Held {
    /// The distance of the plates: the force relaxes.
    Thickness,
    /// The force: the breast becomes thinner.
    Force,
}

/// How long each phase lasts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phases {
    /// Closing (s), at an even speed.
    pub ramp_s: f64,
    /// Clamping (s).
    pub clamp_s: f64,
    /// Opening (s), at an even speed.
    pub release_s: f64,
    /// What is held in between.
    pub held: Held,
}

/// One moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// Time since the plates began to close (s).
    pub time_s: f64,
    /// Distance of the plates (mm).
    pub plates_mm: f64,
    /// Thickness of the breast (mm): that of the plates until they leave it.
    pub breast_mm: f64,
    /// Force of the paddle (mN).
    pub force_mn: f64,
    /// Elastic force at this thickness of the breast (mN): what the force would come to.
    pub elastic_mn: f64,
}

/// The moments of a course, evenly spaced in each phase.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeCourse {
    /// From the first touch to the end of the release.
    pub instants: Vec<Instant>,
    /// Indices of the moments at which clamping begins and ends.
    pub clamp: [usize; 2],
}

impl TimeCourse {
    /// Work (µJ) that the plates did on the breast, and what it gave back.
    pub fn work_uj(&self) -> [f64; 2] {
        let mut work = [0.0; 2];
        for pair in self.instants.windows(2) {
            let done = 0.5
                * (pair[0].force_mn + pair[1].force_mn)
                * (pair[0].breast_mm - pair[1].breast_mm);
            work[usize::from(done < 0.0)] += done.abs();
        }
        work
    }

    /// When (s) the paddle leaves the breast; `None` when it never does.
    pub fn lift_off_s(&self) -> Option<f64> {
        let after = &self.instants[self.clamp[1]..];
        let free = after.iter().find(|now| now.breast_mm < now.plates_mm - 1e-9);
        free.map(|now| now.time_s)
    }
}

/// Moments that are kept of each phase.
const KEPT: usize = 60;
/// Steps between two of them.
const STEPS: usize = 8;

/// Closes the plates at an even speed, holds, and opens them along the same way.
///
/// Held by thickness, they close as far as the elastic curve goes. Held by force, they stop where the
/// force of this speed comes to the last one of the elastic curve; the breast then creeps towards the thickness of
/// that curve's end. In the release a force does not fall below zero: the breast is left behind and recovers
/// on its own.
pub fn course(curve: &ElasticCurve, relaxation: &Relaxation, phases: &Phases) -> TimeCourse {
    let [start_mm, end_mm] = curve.ends_mm();
    let goal_mn = curve.force_mn(end_mm);
    let closed_mm = match phases.held {
        Held::Thickness => end_mm,
        Held::Force => {
            let [mut thick, mut thin] = [start_mm, end_mm];
            for _ in 0..60 {
                let middle = 0.5 * (thick + thin);
                let mut walk = Walk::of(curve, relaxation);
                walk.move_plates(phases.ramp_s, middle);
                if walk.memory.force() < goal_mn {
                    thick = middle;
                } else {
                    thin = middle;
                }
            }
            0.5 * (thick + thin)
        }
    };
    let mut walk = Walk::of(curve, relaxation);
    walk.move_plates(phases.ramp_s, closed_mm);
    let begin = walk.instants.len() - 1;
    match phases.held {
        Held::Thickness => walk.move_plates(phases.clamp_s, closed_mm),
        Held::Force => walk.hold_force(phases.clamp_s),
    }
    let end = walk.instants.len() - 1;
    walk.move_plates(phases.release_s, start_mm);
    TimeCourse { instants: walk.instants, clamp: [begin, end] }
}

/// A course on its way.
struct Walk<'a> {
    curve: &'a ElasticCurve,
    memory: Memory<'a>,
    now: Instant,
    instants: Vec<Instant>,
}

impl<'a> Walk<'a> {
    fn of(curve: &'a ElasticCurve, relaxation: &'a Relaxation) -> Self {
        let thickness = curve.ends_mm()[0];
        let mut memory = Memory::of_rest(relaxation);
        memory.advance(0.0, curve.force_mn(thickness));
        let now = Instant {
            time_s: 0.0,
            plates_mm: thickness,
            breast_mm: thickness,
            force_mn: memory.force(),
            elastic_mn: memory.elastic(),
        };
        Self { curve, memory, now, instants: vec![now] }
    }

    /// Brings the plates to a distance (mm) in a time (s).
    fn move_plates(&mut self, time_s: f64, to_mm: f64) {
        if time_s <= 0.0 {
            return;
        }
        let from = self.now;
        for n in 1..=KEPT * STEPS {
            let part = n as f64 / (KEPT * STEPS) as f64;
            let plates_mm = from.plates_mm + part * (to_mm - from.plates_mm);
            let step_s = time_s / (KEPT * STEPS) as f64;
            // Without a force the breast recovers at a pace of its own, slower than the plates.
            let free = self.memory.elastic_for(step_s, 0.0);
            let pressed = self.curve.force_mn(plates_mm);
            let (elastic, breast_mm) = if free > pressed {
                (free, self.curve.thickness_mm(free).min(plates_mm))
            } else {
                (pressed, plates_mm)
            };
            self.memory.advance(step_s, elastic);
            self.keep(n, from.time_s + part * time_s, [plates_mm, breast_mm]);
        }
    }

    /// Holds the force that there is for a time (s).
    fn hold_force(&mut self, time_s: f64) {
        if time_s <= 0.0 {
            return;
        }
        let from = self.now;
        for n in 1..=KEPT * STEPS {
            let step_s = time_s / (KEPT * STEPS) as f64;
            let elastic = self.memory.elastic_for(step_s, from.force_mn);
            self.memory.advance(step_s, elastic);
            let thickness = self.curve.thickness_mm(elastic);
            self.keep(n, from.time_s + n as f64 * step_s, [thickness; 2]);
        }
    }

    fn keep(&mut self, n: usize, time_s: f64, [plates_mm, breast_mm]: [f64; 2]) {
        // Rounding leaves a force of 1e-17 of a breast that is free.
        let force_mn = if breast_mm < plates_mm { 0.0 } else { self.memory.force().max(0.0) };
        let elastic_mn = self.memory.elastic();
        self.now = Instant { time_s, plates_mm, breast_mm, force_mn, elastic_mn };
        if n.is_multiple_of(STEPS) {
            self.instants.push(self.now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Decay;
    use super::*;

    const PHASES: Phases =
        Phases { ramp_s: 7.5, clamp_s: 12.8, release_s: 2.0, held: Held::Thickness };

    /// 2 mN a millimetre, from 80 to 50 mm.
    fn linear() -> ElasticCurve {
        ElasticCurve::through(&[80.0, 75.0, 50.0], &[0.0, 10.0, 60.0]).unwrap()
    }

    fn kernel() -> Relaxation {
        let creep = [Decay { share: 0.5, time_s: 3.2 }, Decay { share: 0.5, time_s: 42.0 }];
        Relaxation::of_creep(&creep)
    }

    #[test]
    fn an_elastic_breast_goes_back_the_way_it_came_and_gives_all_work_back() {
        for held in [Held::Thickness, Held::Force] {
            let made = course(&linear(), &Relaxation::default(), &Phases { held, ..PHASES });
            assert_eq!(made.clamp, [KEPT, 2 * KEPT]);
            for now in &made.instants {
                assert!((now.force_mn - 2.0 * (80.0 - now.plates_mm)).abs() < 1e-9, "{now:?}");
                assert!((now.breast_mm - now.plates_mm).abs() < 1e-9);
            }
            let [done, back] = made.work_uj();
            assert!((done - 900.0).abs() < 1e-6 && (back - 900.0).abs() < 1e-6, "{done} {back}");
            assert!((made.instants[made.clamp[0]].plates_mm - 50.0).abs() < 1e-9);
        }
    }

    /// Verifies: plates that close and hold a linear body, two terms | closed form | 1e-10
    #[test]
    fn ramp_and_clamping_are_those_of_the_closed_form() {
        let (kernel, rate) = (kernel(), 60.0 / 7.5);
        let made = course(&linear(), &kernel, &PHASES);
        for now in &made.instants[..=made.clamp[1]] {
            let closing = now.time_s.min(7.5);
            let part = |d: &Decay| {
                let grown = 1.0 - (-closing / d.time_s).exp();
                d.share * d.time_s * grown * (-(now.time_s - closing) / d.time_s).exp()
            };
            let exact = rate * (closing + kernel.decays.iter().map(part).sum::<f64>());
            assert!((now.force_mn - exact).abs() < 1e-10, "{now:?} {exact}");
        }
    }

    #[test]
    fn a_held_force_stays_and_the_breast_creeps_towards_the_elastic_thickness() {
        let phases = Phases { held: Held::Force, clamp_s: 12.8, ..PHASES };
        let made = course(&linear(), &kernel(), &phases);
        let held = &made.instants[made.clamp[0]..=made.clamp[1]];
        assert!(held.iter().all(|now| (now.force_mn - 60.0).abs() < 1e-9));
        assert!(held.windows(2).all(|pair| pair[1].plates_mm < pair[0].plates_mm));
        let long = Phases { clamp_s: 600.0, ..phases };
        let made = course(&linear(), &kernel(), &long);
        let end = made.instants[made.clamp[1]];
        assert!((end.plates_mm - 50.0).abs() < 1e-3, "{end:?}");
    }

    #[test]
    fn a_slow_ramp_is_elastic_and_a_fast_one_is_as_stiff_as_the_kernel_at_once() {
        for (ramp_s, factor, near) in [(1e6, 1.0, 1e-4), (1e-4, 2.0, 1e-4)] {
            let made = course(&linear(), &kernel(), &Phases { ramp_s, ..PHASES });
            let force = made.instants[made.clamp[0]].force_mn;
            assert!((force / 60.0 / factor - 1.0).abs() < near, "{force}");
        }
    }

    #[test]
    fn the_release_lags_behind_and_never_pulls() {
        let made = course(&linear(), &kernel(), &PHASES);
        let after = &made.instants[made.clamp[1]..];
        assert!(after.iter().all(|now| now.force_mn >= 0.0 && now.breast_mm <= now.plates_mm));
        let free = made.lift_off_s().unwrap();
        assert!(free > 20.3 && free < 22.3, "{free}");
        // From there on without a force, and thicker with time.
        let left: Vec<_> = after.iter().filter(|now| now.time_s >= free).collect();
        assert!(left.len() > 3 && left.iter().all(|now| now.force_mn == 0.0));
        assert!(left.windows(2).all(|pair| pair[1].breast_mm > pair[0].breast_mm));
        let [done, back] = made.work_uj();
        assert!(back > 0.2 * done && back < 0.9 * done, "{done} {back}");
    }

    /// Verifies: plates that close and open, one term | closed form | force 1e-9, work 1e-4
    #[test]
    fn work_is_lost_as_the_closed_form_says() {
        // One term, no clamping, opened as fast as closed: a triangle of the thickness in time.
        let (a, tau, ramp) = (0.4, 3.0, 6.0);
        let kernel = Relaxation { decays: vec![Decay { share: a, time_s: tau }] };
        let phases = Phases { ramp_s: ramp, clamp_s: 0.0, release_s: ramp, held: Held::Thickness };
        let made = course(&linear(), &kernel, &phases);
        let rate = 60.0 / ramp;
        let up = |t: f64| rate * (t + a * tau * (1.0 - (-t / tau).exp()));
        let down = |t: f64| {
            let part = a * tau * (1.0 - (-ramp / tau).exp());
            let left = part * (-t / tau).exp() - a * tau * (1.0 - (-t / tau).exp());
            rate * (ramp - t + left)
        };
        let lift = made.lift_off_s().unwrap();
        for now in &made.instants {
            let exact = if now.time_s <= ramp { up(now.time_s) } else { down(now.time_s - ramp) };
            let here = if now.time_s < lift { exact } else { 0.0 };
            assert!((now.force_mn - here).abs() < 1e-9, "{now:?} {here}");
        }
        // The closed form falls through zero between the moments around the lift-off.
        assert!(down(lift - ramp) <= 1e-9 && down(lift - ramp - ramp / KEPT as f64) > 0.0);
        let speed = 30.0 / ramp;
        let inward = speed
            * rate
            * (ramp * ramp / 2.0 + a * tau * (ramp - tau * (1.0 - (-ramp / tau).exp())));
        let [done, back] = made.work_uj();
        assert!((done / inward - 1.0).abs() < 1e-4, "{done} {inward}");
        assert!(back < done);
    }
}
