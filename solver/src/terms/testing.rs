//! What every term obeys, checked in one call from each term's tests.

use super::{At, Block, Order, Term};
use mammotwin_data::Vec3;

/// Panics unless the gradient of every element is the derivative of its energy, and its second
/// derivatives those of its gradient, with `at.points` moved a little in every direction.
///
/// # Panics
/// When a derivative is wrong.
#[track_caller]
pub fn check(term: &dyn Term, at: &At) {
    let full = |element: usize, points: &[Vec3]| {
        let mut block = Block::ZERO;
        let at = At { points, ..*at };
        term.block(element, &at, Order::Hessian, &mut block).expect("an admissible state");
        block
    };
    for element in 0..term.elements() {
        let nodes = term.nodes(element);
        let here = full(element, at.points);
        let scale = (0..nodes.len())
            .flat_map(|a| (0..=a).map(move |b| (a, b)))
            .map(|(a, b)| here.hessian[a][b].norm())
            .fold(0.0, f64::max);
        let force = here.gradient.iter().map(|g| g.norm()).fold(0.0, f64::max);
        let step = 1e-4;
        for (b, &node) in nodes.iter().enumerate() {
            for axis in 0..3 {
                let moved = |t: f64| {
                    let mut points = at.points.to_vec();
                    points[node as usize][axis] += t * step;
                    full(element, &points)
                };
                let blocks = [moved(-2.0), moved(-1.0), moved(1.0), moved(2.0)];
                // Fourth-order central difference.
                let slope = |value: &dyn Fn(&Block) -> f64| {
                    let v = [0, 1, 2, 3].map(|n| value(&blocks[n]));
                    (v[0] - 8.0 * v[1] + 8.0 * v[2] - v[3]) / (12.0 * step)
                };
                let tension: f64 = if term.is_mixed() {
                    nodes.iter().map(|&n| at.pressure[n as usize]).sum()
                } else {
                    0.0
                };
                let energy = slope(&|block| block.energy + tension * block.dilatation);
                assert!(
                    (energy - here.gradient[b][axis]).abs() <= 1e-7 * (force + step * scale),
                    "{} element {element}: dE/dx[{b}][{axis}] = {energy}, gradient {}",
                    term.name(),
                    here.gradient[b][axis]
                );
                if term.is_mixed() {
                    let dilatation = slope(&|block| block.dilatation);
                    assert!(
                        (dilatation - here.dilatation_gradient[b][axis]).abs()
                            <= 1e-7 * (1.0 + here.dilatation_gradient[b].norm()),
                        "{} element {element}: dilatation gradient",
                        term.name()
                    );
                }
                for a in b..nodes.len() {
                    for i in 0..3 {
                        let want = slope(&|block| block.gradient[a][i]);
                        let got = here.hessian[a][b][(i, axis)];
                        assert!(
                            (got - want).abs() <= 1e-6 * (scale + 1e-3 * force),
                            "{} element {element}: d²E/dx[{a}][{i}]dx[{b}][{axis}] = {want}, \
                             Hessian {got}",
                            term.name()
                        );
                    }
                }
            }
        }
    }
}
