//! Which effect of the image chain a measured unit has and the image model lacks.
//!
//! Measured are a breast, a uniform slab, a test object with grains, and doses under tilted paddles;
//! each once for the search and once, of another thickness, held out. Logarithmic signals of 5 mm cells,
//! contrasts of rings around grains and doses are compared with the [image model](library::Chain), weighed
//! with quantum noise and an uneven gain of the detector. A score test asks for each effect of the
//! [library] whether what exposure, glandularity and contrast do not take of its signature is in the
//! residuals; the best are fitted; what is left in smooth shapes says that something else is missing;
//! exposures that the search never saw decide.

pub mod evidence;
pub mod field;
pub mod grains;
pub mod library;
pub mod search;
pub mod trial;
