//! The reduced relaxation function, and the convolution with it.

/// One exponential that dies away.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decay {
    /// Its share of the long-term value.
    pub share: f64,
    /// Its time constant (s).
    pub time_s: f64,
}

/// G(t) = 1 + Σ aᵢ exp(-t/τᵢ): force after a step of the thickness, over the long-term force.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Relaxation {
    /// aᵢ and τᵢ.
    pub decays: Vec<Decay>,
}

impl Relaxation {
    /// The relaxation of a body that creeps under a constant force: its strain is the elastic one times
    /// 1 + Σ cᵢ (1 - exp(-t/Tᵢ)), with a share cᵢ and a retardation time Tᵢ for each term of `creep`.
    /// Times are positive and differ, shares are positive; shares of zero are left out.
    ///
    /// The Carson transforms of compliance and relaxation are reciprocal, G* = (1 + Σ cᵢ)/D with
    /// D(s) = 1 + Σ cᵢ/(1 + s Tᵢ) (Tschoegl 1989). The rates of relaxation are the roots of D(-r): one lies between each 1/Tᵢ
    /// and the next, the last one below (1 + Σ cᵢ)/T of the shortest T.
    pub fn of_creep(creep: &[Decay]) -> Self {
        let mut terms: Vec<Decay> = creep.iter().copied().filter(|c| c.share > 0.0).collect();
        terms.sort_by(|a, b| b.time_s.total_cmp(&a.time_s));
        let all: f64 = terms.iter().map(|c| c.share).sum();
        let at = |r: f64| 1.0 + terms.iter().map(|c| c.share / (1.0 - r * c.time_s)).sum::<f64>();
        let decay = |n: usize| {
            let mut low = 1.0 / terms[n].time_s;
            let most = (1.0 + all) / terms[n].time_s;
            let mut high = terms.get(n + 1).map_or(most, |next| 1.0 / next.time_s);
            // D(-r) rises from -∞ at the lower end.
            for _ in 0..200 {
                let middle = 0.5 * (low + high);
                if at(middle) > 0.0 {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            let rate = 0.5 * (low + high);
            let slope = |c: &Decay| c.share * c.time_s / (1.0 - rate * c.time_s).powi(2);
            let share = (1.0 + all) / (rate * terms.iter().map(slope).sum::<f64>());
            Decay { share, time_s: 1.0 / rate }
        };
        let mut decays: Vec<Decay> = (0..terms.len()).map(decay).collect();
        decays.reverse();
        Self { decays }
    }

    /// G at a time (s) after the step.
    pub fn at(&self, time_s: f64) -> f64 {
        1.0 + self.decays.iter().map(|d| d.share * (-time_s / d.time_s).exp()).sum::<f64>()
    }
}

/// The force so far, as the sum of the elastic one and of one part for each exponential.
///
/// A step in which the elastic force goes in a straight line is exact; of a smooth history the error
/// is of second order in the step.
#[derive(Debug, Clone)]
pub struct Memory<'a> {
    relaxation: &'a Relaxation,
    /// Elastic force now.
    elastic: f64,
    /// What each exponential adds to it.
    parts: Vec<f64>,
}

impl<'a> Memory<'a> {
    /// A body that was at rest without force for ever.
    pub fn of_rest(relaxation: &'a Relaxation) -> Self {
        Self { relaxation, elastic: 0.0, parts: vec![0.0; relaxation.decays.len()] }
    }

    /// Force now.
    pub fn force(&self) -> f64 {
        self.elastic + self.parts.iter().sum::<f64>()
    }

    /// Elastic force now: what the force would come to at this thickness.
    pub fn elastic(&self) -> f64 {
        self.elastic
    }

    /// Lets a time (s, 0 for a jump) pass in which the elastic force goes to `elastic`.
    pub fn advance(&mut self, step_s: f64, elastic: f64) {
        let change = elastic - self.elastic;
        for (part, decay) in self.parts.iter_mut().zip(&self.relaxation.decays) {
            let (kept, taken) = factors(step_s / decay.time_s);
            *part = kept * *part + decay.share * taken * change;
        }
        self.elastic = elastic;
    }

    /// The elastic force at the end of a step (s) after which the force is `force`.
    pub fn elastic_for(&self, step_s: f64, force: f64) -> f64 {
        let (mut memory, mut weight) = (0.0, 0.0);
        for (part, decay) in self.parts.iter().zip(&self.relaxation.decays) {
            let (kept, taken) = factors(step_s / decay.time_s);
            memory += kept * part;
            weight += decay.share * taken;
        }
        (force - memory + weight * self.elastic) / (1.0 + weight)
    }
}

/// What is left of a part after a step of `x` time constants, and what it takes of a change that is
/// spread evenly over the step.
fn factors(x: f64) -> (f64, f64) {
    let taken = if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 };
    ((-x).exp(), taken)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(share: f64, time_s: f64) -> Relaxation {
        Relaxation { decays: vec![Decay { share, time_s }] }
    }

    fn spectrum() -> [Decay; 2] {
        [Decay { share: 0.5, time_s: 3.2 }, Decay { share: 0.5, time_s: 42.0 }]
    }

    /// Verifies: relaxation of a step, two terms | closed form | 1e-13
    #[test]
    fn a_step_relaxes_as_the_kernel() {
        let kernel = Relaxation { decays: spectrum().to_vec() };
        let mut memory = Memory::of_rest(&kernel);
        memory.advance(0.0, 3.0);
        assert!((memory.force() - 3.0 * kernel.at(0.0)).abs() < 1e-14);
        // However the time is cut.
        for (n, step) in [0.1, 2.0, 7.3, 0.01, 40.0].into_iter().enumerate() {
            memory.advance(step, 3.0);
            let time: f64 = [0.1, 2.0, 7.3, 0.01, 40.0][..=n].iter().sum();
            assert!((memory.force() - 3.0 * kernel.at(time)).abs() < 1e-13);
        }
        memory.advance(1e6, 3.0);
        assert!((memory.force() - 3.0).abs() < 1e-12);
    }

    /// Verifies: relaxation: ramp and hold, one term | closed form | 1e-12
    #[test]
    fn a_ramp_and_what_is_held_after_it_are_those_of_the_closed_form() {
        let (a, tau, rate, ramp) = (0.7, 3.2, 2.0, 7.5);
        let kernel = one(a, tau);
        let mut memory = Memory::of_rest(&kernel);
        let up = |t: f64| rate * (t + a * tau * (1.0 - (-t / tau).exp()));
        let mut time: f64 = 0.0;
        while time < ramp - 1e-9 {
            time += 0.5;
            memory.advance(0.5, rate * time);
            assert!((memory.force() - up(time)).abs() < 1e-12, "{time}");
        }
        for held in [1.0f64, 5.0, 12.8] {
            let mut memory = memory.clone();
            memory.advance(held, rate * ramp);
            let over = a * tau * (1.0 - (-ramp / tau).exp()) * (-held / tau).exp();
            assert!((memory.force() - rate * (ramp + over)).abs() < 1e-12);
        }
    }

    #[test]
    fn without_shares_it_is_elastic() {
        for kernel in [Relaxation::default(), one(0.0, 3.2), Relaxation::of_creep(&[])] {
            let mut memory = Memory::of_rest(&kernel);
            for (step, elastic) in [(0.0, 1.0), (2.0, 4.0), (0.1, 0.5)] {
                assert_eq!(memory.elastic_for(step, elastic), elastic);
                memory.advance(step, elastic);
                assert_eq!(memory.force(), elastic);
            }
        }
    }

    /// Verifies: relaxation: force of a curved history | closed form | order 2 ± 0.05
    #[test]
    fn a_curved_history_converges_with_the_second_order() {
        let (a, tau, end) = (1.0, 3.2, 7.5);
        let kernel = one(a, tau);
        // Elastic force t².
        let exact = end * end + 2.0 * a * tau * (end - tau * (1.0 - (-end / tau).exp()));
        let error = |steps: u32| {
            let mut memory = Memory::of_rest(&kernel);
            let step = end / f64::from(steps);
            for n in 1..=steps {
                memory.advance(step, (f64::from(n) * step).powi(2));
            }
            (memory.force() - exact).abs()
        };
        for steps in [8, 16, 32] {
            let order = (error(steps) / error(2 * steps)).log2();
            assert!((order - 2.0).abs() < 0.05, "{order}");
        }
    }

    #[test]
    fn creep_of_one_term_relaxes_faster_by_one_and_its_share() {
        let kernel = Relaxation::of_creep(&[Decay { share: 1.0, time_s: 3.2 }]);
        let [decay] = kernel.decays[..] else { panic!("{kernel:?}") };
        assert!((decay.share - 1.0).abs() < 1e-12 && (decay.time_s - 1.6).abs() < 1e-12);
    }

    /// Verifies: creep of a held force, three terms | closed form | order 2 ± 0.05
    #[test]
    fn a_force_that_is_held_creeps_as_the_spectrum_that_the_kernel_was_made_of() {
        let creep = [spectrum()[0], spectrum()[1], Decay { share: 0.3, time_s: 0.4 }];
        let kernel = Relaxation::of_creep(&creep);
        let all: f64 = creep.iter().map(|c| c.share).sum();
        assert!((kernel.at(0.0) - 1.0 - all).abs() < 1e-12, "{kernel:?}");
        let strain = |t: f64| {
            let grown = |c: &Decay| c.share * (1.0 - (-t / c.time_s).exp());
            (1.0 + creep.iter().map(grown).sum::<f64>()) / (1.0 + all)
        };
        let (end, force) = (12.8, 5.0);
        let error = |steps: u32| {
            let mut memory = Memory::of_rest(&kernel);
            memory.advance(0.0, force / (1.0 + all));
            assert!((memory.force() - force).abs() < 1e-12);
            let step = end / f64::from(steps);
            for _ in 0..steps {
                memory.advance(step, memory.elastic_for(step, force));
                assert!((memory.force() - force).abs() < 1e-12);
            }
            (memory.elastic() - force * strain(end)).abs()
        };
        for steps in [128, 256] {
            let order = (error(steps) / error(2 * steps)).log2();
            assert!((order - 2.0).abs() < 0.05, "{order}");
        }
        assert!(error(512) < 1e-4 * force, "{}", error(512));
    }
}
