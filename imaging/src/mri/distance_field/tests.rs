//! Fields of masks with closed forms.

use super::*;
use mammotwin_data::Mat3;
use nalgebra::Rotation3;

/// A mask of `inside` on a grid around the origin.
fn mask(axes: Mat3, half_extent: f64, inside: impl Fn(&Vec3) -> bool) -> Volume<bool> {
    let steps = [0, 1, 2].map(|axis| axes.column(axis).norm());
    let shape = steps.map(|step| (2.0 * half_extent / step).ceil() as usize + 1);
    let middle = Vec3::from(shape.map(|n| 0.5 * (n - 1) as f64));
    let grid = Grid { shape, axes, origin: -axes * middle };
    let values = (0..grid.len()).map(|n| inside(&grid.center(grid.voxel(n)))).collect();
    Volume { grid, values }
}

/// Oblique, flipped, with thick slices.
fn thick_slices() -> Mat3 {
    let turn = Rotation3::new(Vec3::new(0.2, -0.1, 0.3));
    turn.matrix() * Mat3::from_diagonal(&Vec3::new(-1.289, 1.289, 3.3))
}

/// Distances near the surface of a ball against the closed form: mean, root mean square, largest.
fn ball_errors(axes: Mat3, radius: f64, spacing_mm: f64) -> (f64, f64, f64) {
    let center = Vec3::new(0.3, -0.2, 0.1);
    let mask = mask(axes, radius + 12.0, |p| (p - center).norm() < radius);
    let plan = FieldPlan { margin_mm: 8.0, ..FieldPlan::of_spacing(spacing_mm) };
    let field = distance_field(&mask, &plan).unwrap();
    let (mut sum, mut square, mut worst, mut count) = (0.0, 0.0, 0.0f64, 0.0);
    for n in 0..field.values.len() {
        let exact = (field.grid.center(field.grid.voxel(n)) - center).norm() - radius;
        if exact.abs() < 6.0 {
            let error = f64::from(field.values[n]) - exact;
            (sum, square, count) = (sum + error, square + error * error, count + 1.0);
            worst = worst.max(error.abs());
        }
    }
    (sum / count, (square / count).sqrt(), worst)
}

#[test]
fn distances_to_a_ball_are_sub_voxel_on_any_grid() {
    let (mean, rms, worst) = ball_errors(Mat3::identity(), 30.0, 1.0);
    println!("1 mm: mean {mean:.3} rms {rms:.3} worst {worst:.3}");
    // Three times the mean over the radius is the error of volume: half a percent is 0.05 mm.
    // The largest errors are at the poles, where a layer of voxels is flat.
    assert!(mean.abs() < 0.03 && rms < 0.1 && worst < 0.7);
    let (mean, rms, worst) = ball_errors(thick_slices(), 30.0, 1.5);
    println!("1.289 x 1.289 x 3.3 mm: mean {mean:.3} rms {rms:.3} worst {worst:.3}");
    assert!(mean.abs() < 0.05 && rms < 0.3 && worst < 0.5 * 3.3);
}

#[test]
fn an_oblique_plane_has_no_stairs() {
    let normal = Vec3::new(0.15, 0.25, 1.0).normalize();
    for axes in [Mat3::identity(), thick_slices()] {
        let mask = mask(axes, 30.0, |p| p.dot(&normal) < 0.4);
        let plan = FieldPlan { margin_mm: 0.0, ..FieldPlan::of_spacing(1.5) };
        let field = distance_field(&mask, &plan).unwrap();
        let mut worst = 0.0f64;
        for n in 0..field.values.len() {
            let p = field.grid.center(field.grid.voxel(n));
            let exact = p.dot(&normal) - 0.4;
            if p.norm() < 18.0 && exact.abs() < 4.0 {
                worst = worst.max((f64::from(field.values[n]) - exact).abs());
            }
        }
        let step = axes.column(2).norm();
        println!("slices of {step:.1} mm: worst {worst:.3} mm");
        assert!(worst < 0.25 * step, "{worst}");
    }
}

#[test]
fn redistancing_keeps_the_distance_to_a_ball() {
    let grid = Grid::aligned([61, 61, 61], [1.5; 3], Vec3::repeat(-45.0));
    let exact = |p: &Vec3| p.norm() - 25.3;
    // The same zero level, but no distance.
    let values = (0..grid.len()).map(|n| {
        let d = exact(&grid.center(grid.voxel(n)));
        (3.0 * (d / 10.0).tanh()) as f32
    });
    let level = Volume { values: values.collect(), grid };
    let field = redistance(&level);
    let error = |n: usize| {
        let d = exact(&field.grid.center(field.grid.voxel(n)));
        (f64::from(field.values[n]) - d).abs()
    };
    let worst = (0..field.values.len()).map(error).fold(0.0, f64::max);
    println!("worst {worst:.3} mm on a grid of 1.5 mm");
    assert!(worst < 0.1 * 1.5, "{worst} mm");
}

#[test]
fn masks_without_a_surface_are_refused() {
    let empty = mask(Mat3::identity(), 5.0, |_| false);
    let error = distance_field(&empty, &FieldPlan::of_spacing(1.0)).err().unwrap();
    assert_eq!(error, FieldError::NoSurface { inside: 0, all: empty.values.len() });
    let ball = mask(Mat3::identity(), 5.0, |p| p.norm() < 3.0);
    for spacing_mm in [0.0, f64::NAN, 1e-4] {
        let plan = FieldPlan { spacing_mm, ..FieldPlan::of_spacing(1.0) };
        assert!(matches!(distance_field(&ball, &plan), Err(FieldError::BadInput(_))));
    }
}
