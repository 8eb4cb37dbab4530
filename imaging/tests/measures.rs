//! What is measured of a breast, on shapes whose measures are known.

use mammotwin_data::{
    Vec3,
    labels::{Side, Tissue},
    surface::TriMesh,
    volume::{Grid, Volume},
};
use mammotwin_imaging::mri::{
    breast::{self, Volumes},
    distance_field::{FieldPlan, level_field},
    skin::{NoSkin, thickness},
    surface::surface,
};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};

const RADIUS: f64 = 45.0;

/// An eighth of a ball under skin that is thicker towards +x, with shading and noise.
fn ball(voxel_mm: f64, skin: f64, thickness: impl Fn(&Vec3) -> f64) -> (Volume<f32>, TriMesh) {
    let n = (54.0 / voxel_mm) as usize;
    let grid = Grid::aligned([n; 3], [voxel_mm; 3], Vec3::repeat(-4.0));
    let signal = |p: &Vec3| {
        let depth = RADIUS - p.norm();
        if depth < 0.0 {
            0.0
        } else if depth < thickness(p) {
            skin
        } else {
            1.0
        }
    };
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let noise = Normal::new(0.0, 0.02).unwrap();
    let value = |n: usize| {
        let center = grid.center(grid.voxel(n));
        let corner = |c: usize| {
            let side = |axis: usize| ((c >> axis & 1) as f64 - 0.5) * 0.5 * voxel_mm;
            signal(&(center + Vec3::new(side(0), side(1), side(2))))
        };
        let mean = (0..8).map(corner).sum::<f64>() / 8.0;
        let shading = 0.6 + 0.4 * center.x / RADIUS;
        (700.0 * (mean * shading + noise.sample(&mut random)).abs()) as f32
    };
    let values = (0..grid.len()).map(value).collect();
    let inside = (0..grid.len()).map(|n| grid.center(grid.voxel(n)).norm() < RADIUS).collect();
    let mask = Volume { grid: grid.clone(), values: inside };
    let skin = surface(&level_field(&mask, &FieldPlan::of_spacing(1.5)).unwrap());
    (Volume { grid, values }, skin)
}

/// The round part of the surface.
fn round(skin: &TriMesh) -> Vec<bool> {
    skin.points.iter().map(|p| p.min() > 3.0 && (p.norm() - RADIUS).abs() < 1.0).collect()
}

#[test]
fn skin_of_known_thickness_is_measured_to_a_tenth_of_a_millimetre() {
    for brightness in [0.36, 0.55] {
        let truth = |p: &Vec3| 0.9 + 1.5 * p.x / p.norm();
        let (image, skin) = ball(1.0, brightness, truth);
        let wanted = round(&skin);
        let map = thickness(&image, &skin, &wanted).unwrap();
        let errors: Vec<f64> = (0..wanted.len())
            .filter_map(|n| Some(map.thickness_mm[n]? - truth(&skin.points[n])))
            .collect();
        let count = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / count;
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
        println!(
            "skin of {brightness}: found {:.3}, blur {:.2}; {count} places, mean error \
             {mean:.3} mm, rms {rms:.3} mm",
            map.brightness, map.blur
        );
        let asked = wanted.iter().filter(|w| **w).count() as f64;
        assert!(count > 0.9 * asked, "{count} of {asked}");
        assert!((map.brightness - brightness).abs() < 0.06);
        assert!(mean.abs() < 0.15 && rms < 0.2);
    }
}

#[test]
fn what_does_not_show_skin_gives_no_thickness() {
    let (image, skin) = ball(1.5, 0.36, |_| 1.5);
    let wanted = round(&skin);
    assert_eq!(thickness(&image, &skin, &wanted).err(), Some(NoSkin::Coarse { voxel_mm: 1.5 }));
    let (image, skin) = ball(1.0, 1.0, |_| 1.5);
    assert_eq!(thickness(&image, &skin, &round(&skin)).err(), Some(NoSkin::NoContrast));
}

#[test]
fn skin_belongs_to_the_breast_under_it_and_shares_are_of_what_it_covers() {
    use Tissue::*;
    let grid = Grid::aligned([7, 2, 1], [2.0, 1.0, 1.0], Vec3::zeros());
    let values = vec![
        AdiposeLeft,
        AdiposeLeft,
        FibroglandularLeft,
        PectoralMuscle,
        FibroglandularRight,
        AdiposeRight,
        Other, // row of fat
        Skin,
        Skin,
        NippleAreola,
        Background,
        Skin,
        Skin,
        Skin, // row of skin
    ];
    let labels = Volume { grid, values };
    let sides = breast::sides(&labels);
    let right = Volumes::of(&labels, &sides, Side::Right);
    let left = Volumes::of(&labels, &sides, Side::Left);
    assert_eq!(right, Volumes { fat_mm3: 2.0, gland_mm3: 2.0, cover_mm3: 6.0 });
    assert_eq!(left, Volumes { fat_mm3: 4.0, gland_mm3: 2.0, cover_mm3: 6.0 });
    assert_eq!((right.total_mm3(), left.gland_share()), (10.0, Some(1.0 / 3.0)));
    assert_eq!(sides[3], None);
    assert_eq!(Volumes::default().gland_share(), None);
}

#[test]
fn a_nipple_is_found_beside_the_farthest_point_and_a_smooth_breast_has_none() {
    let grid = Grid::aligned([70, 50, 70], [1.5; 3], Vec3::new(-52.0, -10.0, -52.0));
    let tip = Vec3::new(18.0, 0.0, 10.0);
    let tip = Vec3::new(tip.x, 40.0 * (1.0 - (tip.norm() / 45.0).powi(2)).sqrt(), tip.z);
    let found = |nipple: bool| {
        let inside = |p: &Vec3| {
            let dome = (p.x / 45.0).powi(2) + (p.z / 45.0).powi(2) + (p.y / 40.0).powi(2);
            p.y > 0.0 && (dome < 1.0 || (nipple && (p - tip).norm() < 5.5))
        };
        let values = (0..grid.len()).map(|n| inside(&grid.center(grid.voxel(n)))).collect();
        let mask = Volume { grid: grid.clone(), values };
        let skin = surface(&level_field(&mask, &FieldPlan::of_spacing(1.5)).unwrap());
        // Not the plane behind the dome.
        let wanted: Vec<bool> = skin.points.iter().map(|p| p.y > 6.0).collect();
        let wall: Vec<f64> = skin.points.iter().map(|p| p.y).collect();
        let heights = breast::bumps(&skin, &wanted);
        breast::nipple(&heights, &wanted, &wall).map(|n| (skin.points[n], heights[n]))
    };
    let (at, height) = found(true).unwrap();
    let off = (at - tip).norm();
    println!("nipple {height:.1} mm over the smooth skin, {off:.1} mm from its centre");
    assert!(off < 7.0, "{at}: {off} mm");
    assert_eq!(found(false), None);
}
