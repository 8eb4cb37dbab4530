//! Small results are kept as readable JSON.

use mammotwin_data::Failure;
use serde::{Serialize, de::DeserializeOwned};
use std::{fs, io::Write, path::Path};

/// Writes `value` to a new file as indented JSON.
pub fn save_json<T: Serialize>(value: &T, path: &Path) -> Result<(), Failure> {
    let mut text = serde_json::to_vec_pretty(value).map_err(|error| Failure::io(path, error))?;
    text.push(b'\n');
    let mut file = fs::File::create(path).map_err(|error| Failure::io(path, error))?;
    file.write_all(&text).and_then(|()| file.sync_all()).map_err(|error| Failure::io(path, error))
}

/// Reads what [`save_json`] wrote.
pub fn load_json<T: DeserializeOwned>(path: &Path) -> Result<T, Failure> {
    let text = fs::read(path).map_err(|error| Failure::io(path, error))?;
    serde_json::from_slice(&text).map_err(|error| Failure::io(path, error))
}
