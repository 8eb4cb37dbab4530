//! Errors of the measurement that must not look like physics.

/// An error, and how the search keeps it apart.
#[derive(Debug)]
pub struct Artefact {
    /// Its word.
    pub name: &'static str,
    /// One sentence for people.
    pub sentence: &'static str,
    /// What the search does about it.
    pub treatment: &'static str,
}

/// What a verdict names as `measurement_artifact`.
pub(super) const REGISTRATION: &str = "registration";

/// All of them. Only a pose that lies wrong as a whole is named; the others are in the error budget.
pub const ARTEFACTS: [Artefact; 4] = [
    Artefact {
        name: REGISTRATION,
        sentence: "A pose lies a little beside where the registration puts it.",
        treatment: "the rigid motion of every pose is left open; named where a pose lies more than 4 mm off",
    },
    Artefact {
        name: "segmentation_bias",
        sentence: "A surface lies too far out or in as a whole.",
        treatment: "0.3 mm, alike over the whole skin, is in the covariance of every pose",
    },
    Artefact {
        name: "chest_wall_change",
        sentence: "The chest wall itself changes its shape between the poses.",
        treatment: "1.05 mm an axis, alike over 60 mm, is in the covariance of every pose",
    },
    Artefact {
        name: "mesh_error",
        sentence: "Elements are too large to show what the skin does.",
        treatment: "the mean difference to finer meshes is taken away, their scatter is in the covariance",
    },
];
