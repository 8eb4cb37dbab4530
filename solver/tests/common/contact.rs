//! What contacts between parts of a body obey.

use mammotwin_data::Vec3;
use mammotwin_solver::terms::{At, Block, Curvature, Load, Order, Term};
use nalgebra::Rotation3;

/// The moment with these nodes (mm), multipliers (kPa) and moduli (kPa).
pub fn state_of<'a>(points: &'a [Vec3], memory: &'a [f64], shear_kpa: &'a [f64]) -> At<'a> {
    let curvature = Curvature::Exact;
    At { points, pressure: &[], memory, shear_kpa, load: Load::GRAVITY, curvature }
}

/// Panics unless forces and moments of every element cancel on a body of `size_mm`, and a rigid motion of all nodes changes
/// nothing. Gives the number of elements that press.
#[track_caller]
pub fn balanced(
    term: &dyn Term,
    points: &[Vec3],
    memory: &[f64],
    shear_kpa: &[f64],
    size_mm: f64,
) -> usize {
    let turn = Rotation3::from_euler_angles(0.7, -0.4, 1.9);
    let turned: Vec<Vec3> = points.iter().map(|p| turn * p + Vec3::new(30.0, -7.0, 4.0)).collect();
    let mut pressed = 0;
    for element in 0..term.elements() {
        let block = |points: &[Vec3]| {
            let mut block = Block::ZERO;
            let at = state_of(points, memory, shear_kpa);
            term.block(element, &at, Order::Gradient, &mut block).unwrap();
            block
        };
        let (here, there) = (block(points), block(&turned));
        let size: f64 = here.gradient.iter().map(|g| g.norm()).sum();
        let force: Vec3 = here.gradient.iter().sum();
        let arms = term.nodes(element).iter().map(|&n| points[n as usize]);
        let moment: Vec3 = arms.zip(&here.gradient).map(|(p, g)| p.cross(g)).sum();
        assert!(force.norm() <= 1e-10 * size, "{force} of {size}");
        assert!(moment.norm() <= 1e-9 * size_mm * size, "{moment} of {size}");
        assert!((here.energy - there.energy).abs() <= 1e-9 * here.energy.abs().max(1.0));
        for (one, other) in here.gradient.iter().zip(&there.gradient) {
            assert!((turn * one - other).norm() <= 1e-9 * size);
        }
        pressed += usize::from(size > 1.0);
    }
    pressed
}
