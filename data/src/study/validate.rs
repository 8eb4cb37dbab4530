//! Reads a study and refuses what cannot be meant.

use super::Study;

/// Why a study is refused; the text names the key and says how to mend it.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct StudyError(pub String);

/// Parses the text of a study file.
pub fn parse(text: &str) -> Result<Study, StudyError> {
    toml::from_str(text).map_err(|error| StudyError(error.to_string()))
}
