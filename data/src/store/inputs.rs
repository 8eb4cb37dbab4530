//! What a stage is called with: `&mesh`, `(&mesh, Some(&labels))`, `(&mesh, &scans[..])`.

use super::{Artifact, Stored};
use crate::Failure;
use std::collections::BTreeMap;

/// One input of a call.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// Place among the inputs: `0`, `1`, `2.0`, `2.prone`.
    pub position: String,
    /// Name of the handle; empty for an optional input that is not given.
    pub name: String,
    /// Content hash; `none` for an optional input that is not given, `None` while pending.
    pub content: Option<String>,
}

/// Handles that load to the input of a stage.
pub trait Inputs {
    /// What the stage reads.
    type Loaded;
    /// Appends the sources; `position` is the place of this input.
    fn sources(&self, position: &str, into: &mut Vec<Source>);
    /// Reads all files.
    fn load(&self) -> Result<Self::Loaded, Failure>;
}

fn below(position: &str, place: &dyn std::fmt::Display) -> String {
    if position.is_empty() { place.to_string() } else { format!("{position}.{place}") }
}

impl Inputs for () {
    type Loaded = ();
    fn sources(&self, _position: &str, _into: &mut Vec<Source>) {}
    fn load(&self) -> Result<(), Failure> {
        Ok(())
    }
}

impl<T: Artifact> Inputs for &Stored<T> {
    type Loaded = T;
    fn sources(&self, position: &str, into: &mut Vec<Source>) {
        let position = if position.is_empty() { "0" } else { position };
        let content = self.content().map(String::from);
        into.push(Source { position: position.into(), name: self.name.clone(), content });
    }
    fn load(&self) -> Result<T, Failure> {
        Stored::load(self)
    }
}

impl<T: Artifact> Inputs for Option<&Stored<T>> {
    type Loaded = Option<T>;
    fn sources(&self, position: &str, into: &mut Vec<Source>) {
        match self {
            Some(stored) => stored.sources(position, into),
            None => {
                let position = if position.is_empty() { "0" } else { position };
                let content = Some("none".into());
                into.push(Source { position: position.into(), name: String::new(), content });
            }
        }
    }
    fn load(&self) -> Result<Option<T>, Failure> {
        self.map(Stored::load).transpose()
    }
}

impl<T: Artifact> Inputs for &[Stored<T>] {
    type Loaded = Vec<T>;
    fn sources(&self, position: &str, into: &mut Vec<Source>) {
        for (n, stored) in self.iter().enumerate() {
            stored.sources(&below(position, &n), into);
        }
    }
    fn load(&self) -> Result<Vec<T>, Failure> {
        self.iter().map(Stored::load).collect()
    }
}

impl<T: Artifact> Inputs for &Vec<Stored<T>> {
    type Loaded = Vec<T>;
    fn sources(&self, position: &str, into: &mut Vec<Source>) {
        self.as_slice().sources(position, into);
    }
    fn load(&self) -> Result<Vec<T>, Failure> {
        self.as_slice().load()
    }
}

impl<T: Artifact> Inputs for &BTreeMap<String, Stored<T>> {
    type Loaded = BTreeMap<String, T>;
    fn sources(&self, position: &str, into: &mut Vec<Source>) {
        for (name, stored) in self.iter() {
            stored.sources(&below(position, name), into);
        }
    }
    fn load(&self) -> Result<BTreeMap<String, T>, Failure> {
        self.iter().map(|(name, stored)| Ok((name.clone(), stored.load()?))).collect()
    }
}

macro_rules! tuple_inputs {
    ($($name:ident $place:literal)+) => {
        #[allow(non_snake_case)]
        impl<$($name: Inputs),+> Inputs for ($($name,)+) {
            type Loaded = ($($name::Loaded,)+);
            fn sources(&self, position: &str, into: &mut Vec<Source>) {
                let ($($name,)+) = self;
                $($name.sources(&below(position, &$place), into);)+
            }
            fn load(&self) -> Result<Self::Loaded, Failure> {
                let ($($name,)+) = self;
                Ok(($($name.load()?,)+))
            }
        }
    };
}
tuple_inputs!(A 0);
tuple_inputs!(A 0 B 1);
tuple_inputs!(A 0 B 1 C 2);
tuple_inputs!(A 0 B 1 C 2 D 3);
tuple_inputs!(A 0 B 1 C 2 D 3 E 4);
tuple_inputs!(A 0 B 1 C 2 D 3 E 4 F 5);
tuple_inputs!(A 0 B 1 C 2 D 3 E 4 F 5 G 6);
tuple_inputs!(A 0 B 1 C 2 D 3 E 4 F 5 G 6 H 7);
