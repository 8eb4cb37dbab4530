//! Named points that a person or a marker gives.

use crate::Vec3;
use std::collections::BTreeMap;

/// Points by name, RAS mm. Names that start with `chest_` lie on the chest wall and serve the
/// rigid registration; `breast_` and `nipple_` move with the skin.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Landmarks(pub BTreeMap<String, Vec3>);

impl Landmarks {
    /// Points whose name starts with `prefix` and that `other` has too, in the order of names.
    pub fn pairs(&self, other: &Self, prefix: &str) -> Vec<(String, Vec3, Vec3)> {
        let common = self.0.iter().filter(|(name, _)| name.starts_with(prefix));
        common.filter_map(|(name, here)| Some((name.clone(), *here, *other.0.get(name)?))).collect()
    }
}
