//! Chests with suppressed fat: segmented, or refused; never labels that are wrong.

use crate::phantom;

use mammotwin_data::{labels::Tissue, progress::Silent, rigid::RigidTransform};
use mammotwin_imaging::mri::segment::{Options, SegmentError, Warning, segment};
use phantom::{Contrast, Gland, dice, is_gland, picture_of};

/// From fat in the noise to fat that is nearly as bright as muscle (45), each either divided as it was made
/// or refused.
#[test]
fn suppressed_fat_is_divided_or_refused() {
    divided_or_refused(&[5, 26, 42, 50]);
}

#[test]
#[ignore = "a minute: more brightnesses of fat"]
fn suppressed_fat_of_any_brightness_is_divided_or_refused() {
    divided_or_refused(&[2, 10, 14, 18, 22, 30, 34, 38, 46]);
}

/// Images in which fat has these parts (%) of its brightness.
fn divided_or_refused(percents: &[u8]) {
    let mut wrong = Vec::new();
    for &percent in percents {
        let still = RigidTransform::identity();
        let (image, truth) = picture_of(Contrast::FatAt(percent), 3.0, Gland::Retracted, &still);
        match segment(&image, &Options::default(), &Silent) {
            Err(why) => {
                println!("fat {percent}: {why}");
                assert_eq!(why, SegmentError::NoChestWall);
            }
            Ok(found) => {
                let of = |part: fn(Tissue) -> bool| dice(&found.labels, &truth, part);
                let breast = of(Tissue::is_breast);
                let muscle = of(|tissue| tissue == Tissue::PectoralMuscle);
                let gland = of(is_gland);
                println!(
                    "fat {percent}: breast {breast:.3}, muscle {muscle:.3}, gland {gland:.3}, {:?}",
                    found.warnings
                );
                assert!(found.warnings.contains(&Warning::SuppressedFat));
                let well = breast > 0.9 && muscle > 0.75 && gland > 0.75;
                wrong.extend((!well).then_some(percent));
            }
        }
    }
    assert!(wrong.is_empty(), "fat of {wrong:?} per cent is divided wrongly");
}
