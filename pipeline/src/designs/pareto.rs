//! What is not worse than anything else in everything.

/// Which points lie on the Pareto front: no other is at least as good in every quantity and better in one.
/// Smaller is better. Equal points share the front. A point with a quantity that is not finite is not on it, and no
/// point is compared with it.
pub fn front(points: &[Vec<f64>]) -> Vec<bool> {
    let whole = |point: &[f64]| point.iter().all(|value| value.is_finite());
    let dominates = |a: &[f64], b: &[f64]| {
        let pairs = || a.iter().zip(b);
        pairs().all(|(a, b)| a <= b) && pairs().any(|(a, b)| a < b)
    };
    let best = |point: &Vec<f64>| {
        whole(point) && !points.iter().any(|other| whole(other) && dominates(other, point))
    };
    points.iter().map(best).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of<const N: usize>(points: &[[f64; N]]) -> Vec<bool> {
        front(&points.iter().map(|point| point.to_vec()).collect::<Vec<_>>())
    }

    #[test]
    fn what_is_worse_in_all_is_dominated_and_what_is_better_in_one_is_not() {
        let points = [[1.0, 4.0], [2.0, 2.0], [4.0, 1.0], [3.0, 3.0], [5.0, 0.5]];
        assert_eq!(of(&points), [true, true, true, false, true]);
    }

    #[test]
    fn as_good_in_one_and_worse_in_another_is_dominated() {
        assert_eq!(of(&[[1.0, 2.0], [1.0, 3.0], [0.5, 2.0]]), [false, false, true]);
    }

    #[test]
    fn ties_share_the_front_or_its_outside() {
        assert_eq!(of(&[[1.0, 1.0], [1.0, 1.0]]), [true, true]);
        assert_eq!(of(&[[1.0, 1.0], [0.5, 0.5], [1.0, 1.0]]), [false, true, false]);
    }

    #[test]
    fn a_single_point_is_the_front_and_none_has_none() {
        assert_eq!(of(&[[7.0, 7.0, 7.0]]), [true]);
        assert!(front(&[]).is_empty());
    }

    #[test]
    fn what_was_not_found_neither_wins_nor_beats() {
        let nan = f64::NAN;
        assert_eq!(of(&[[nan, 0.0], [1.0, 1.0], [0.0, nan]]), [false, true, false]);
        assert_eq!(of(&[[nan, nan]]), [false]);
    }

    #[test]
    fn every_point_off_the_front_is_dominated_by_one_on_it() {
        // Points of a fixed sequence in three quantities.
        let mut state: u32 = 1;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 24)
        };
        let points: Vec<Vec<f64>> = (0..60).map(|_| vec![draw(), draw(), draw()]).collect();
        let on = front(&points);
        assert!(on.iter().any(|on| *on) && on.iter().any(|on| !on));
        for (point, on_front) in points.iter().zip(&on) {
            let beaten = points.iter().zip(&on).any(|(other, best)| {
                *best && other != point && other.iter().zip(point).all(|(a, b)| a <= b)
            });
            assert_eq!(beaten, !on_front, "{point:?}");
        }
    }
}
