//! Where the breast leaps to another equilibrium while the plates close.

use super::Course;

/// A node that leaps moves this many times as far as the plates close, and this far (mm). Of 165 steps of 5 to
/// 8 mm with contact in the solver's tests, the farthest node moves up to 1.2 times as far in 154, 1.4 to 2.5
/// times in nine and 3.3 times in two; the force rises on all of them.
const LEAP_PART: f64 = 3.5;
const LEAP_MM: f64 = 2.0;
/// A force that leaps falls by this part of itself, and by this (N): below is what single nodes make that the
/// plates reach or lose.
const FALL_PART: f64 = 0.05;
const FALL_N: f64 = 0.1;

/// A leap between two recorded states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leap {
    /// Number of the state behind it.
    pub state: usize,
    /// Distance of the plates (mm) before and behind it.
    pub thickness_mm: [f64; 2],
    /// Force of the paddle (N).
    pub force_n: [f64; 2],
    /// Largest motion of a node (mm).
    pub moved_mm: f64,
}

impl Course {
    /// Where the breast leaps to another equilibrium: a node moves more than 3.5 times as far as the plates
    /// close, and more than 2 mm, or the force falls by more than 5 %, and 0.1 N, while they close.
    pub fn leaps(&self) -> Vec<Leap> {
        let pair = |values: &[f64], n: usize| [values[n - 1], values[n]];
        let leap = |n: usize| {
            let thickness_mm = pair(&self.thickness_mm, n);
            let force_n = pair(&self.force_n, n);
            let moved_mm = self.moved_mm.get(n).copied().unwrap_or(0.0);
            let closed_mm = thickness_mm[0] - thickness_mm[1];
            let far = moved_mm > LEAP_MM.max(LEAP_PART * closed_mm);
            let fall_n = force_n[0] - force_n[1];
            let falls = closed_mm > 0.0 && fall_n > FALL_N.max(FALL_PART * force_n[0]);
            (far || falls).then_some(Leap { state: n, thickness_mm, force_n, moved_mm })
        };
        (1..self.thickness_mm.len()).filter_map(leap).collect()
    }
}

impl std::fmt::Display for Leap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([_, thickness], [before, behind]) = (self.thickness_mm, self.force_n);
        write!(
            f,
            "At {thickness:.1} mm the breast seems to leap to another equilibrium: {before:.1} → {behind:.1} N, a node moves \
             by {:.0} mm",
            self.moved_mm
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(states: &[[f64; 3]]) -> Course {
        let of = |column: usize| states.iter().map(|state| state[column]).collect();
        Course { thickness_mm: of(0), force_n: of(1), moved_mm: of(2), ..Course::default() }
    }

    #[test]
    fn a_smooth_course_has_no_leap() {
        let smooth = [
            [60.0, 8.0, 0.0],
            [55.0, 12.0, 9.0],
            // Small steps: a node of the front moves three times as far, which is less than 2 mm.
            [54.5, 12.4, 1.6],
            // A dip of a light touch, and one of 4 %.
            [50.0, 20.0, 8.0],
            [49.0, 19.2, 2.0],
        ];
        assert_eq!(course(&smooth).leaps(), []);
        assert_eq!(course(&[[60.0, 0.15, 0.0], [55.0, 0.1, 4.0]]).leaps(), []);
        assert_eq!(Course::default().leaps(), []);
    }

    #[test]
    fn a_node_that_runs_ahead_and_a_force_that_falls_are_leaps() {
        let found = course(&[[55.0, 12.0, 0.0], [50.15, 20.6, 6.0], [50.0, 14.7, 19.0]]).leaps();
        let [leap] = found[..] else { panic!("{found:?}") };
        assert_eq!(
            leap.to_string(),
            "At 50.0 mm the breast seems to leap to another equilibrium: 20.6 → 14.7 N, a node moves by 19 mm"
        );
        assert_eq!(leap.state, 2);
        // By the node alone, by the force alone.
        assert_eq!(course(&[[55.0, 12.0, 0.0], [50.0, 13.0, 18.0]]).leaps().len(), 1);
        assert_eq!(course(&[[55.0, 3.0, 0.0], [50.0, 2.8, 6.0]]).leaps().len(), 1);
    }
}
