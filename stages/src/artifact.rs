//! Results as files: small ones as readable JSON, finished files as their bytes.

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

/// The bytes that `write` puts into a file: some libraries write files only.
pub fn bytes_of(
    name: &str,
    write: impl FnOnce(&Path) -> Result<(), Failure>,
) -> Result<Vec<u8>, Failure> {
    let folder = tempfile::tempdir().map_err(|cause| Failure::io("temporary folder", cause))?;
    let path = folder.path().join(name);
    write(&path)?;
    fs::read(&path).map_err(|cause| Failure::io(&path, cause))
}

/// A finished file, kept as its bytes: `bytes_artifact!("what it is", Name, "extension")`.
macro_rules! bytes_artifact {
    ($doc:literal, $name:ident, $extension:literal) => {
        #[doc = $doc]
        #[derive(Debug, Clone, PartialEq, Eq)]
        pub struct $name(pub Vec<u8>);

        impl mammotwin_data::store::Artifact for $name {
            const EXTENSION: &'static str = $extension;

            fn save(&self, path: &std::path::Path) -> Result<(), mammotwin_data::Failure> {
                std::fs::write(path, &self.0)
                    .map_err(|cause| mammotwin_data::Failure::io(path, cause))
            }

            fn load(path: &std::path::Path) -> Result<Self, mammotwin_data::Failure> {
                std::fs::read(path)
                    .map(Self)
                    .map_err(|cause| mammotwin_data::Failure::io(path, cause))
            }
        }
    };
}
pub(crate) use bytes_artifact;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers.json");
        let numbers: Vec<f64> =
            (1..2000).map(|n| f64::from(n).sqrt() * 10f64.powi(n % 40 - 20)).collect();
        save_json(&numbers, &path).unwrap();
        assert_eq!(load_json::<Vec<f64>>(&path).unwrap(), numbers);
    }
}
