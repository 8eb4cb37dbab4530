//! A person who lies turned on her front.

use super::{Amplitude, Effect, on_the_front};
use mammotwin_data::{Vec3, units::DEGREE};
use nalgebra::{Rotation3, Unit};

pub(super) const EFFECT: Effect = Effect {
    name: "gravity_dir",
    title: "another direction of gravity in the prone pose",
    place: "the prone pose",
    amplitude: Amplitude {
        meaning: "turn of the body about its long axis against what the study says",
        unit: "deg",
        range: [-10.0, 10.0],
        small: 1.0,
    },
    sentence: "In the prone pose gravity does not point where the study says: the person lay turned.",
    signature: "in the prone pose alone, a dipole across the long axis",
    confused_with: &["left_right"],
    separated_by: "the plane of the sternum; an inclinometer on the table",
    apply: |recipe, amplitude, _| {
        if on_the_front(recipe) {
            let axis = Unit::new_unchecked(Vec3::z());
            recipe.gravity = Rotation3::from_axis_angle(&axis, amplitude * DEGREE) * recipe.gravity;
        }
    },
};
