//! Where the keys of a TOML text stand.

use std::{collections::BTreeMap, ops::Range};
use toml::de::{DeTable, DeValue};

/// The keys of a text by their path: `model.skin.young_kpa`, `poses.prone`.
#[derive(Debug, Default)]
pub(super) struct Places {
    keys: BTreeMap<String, Place>,
    line_starts: Vec<usize>,
}

#[derive(Debug)]
struct Place {
    key: Range<usize>,
    value: Range<usize>,
}

impl Places {
    /// Finds the keys; of a text that is no TOML only the lines are known.
    pub fn of(text: &str) -> Self {
        let starts = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(n, _)| n + 1);
        let line_starts = std::iter::once(0).chain(starts).collect();
        let mut places = Self { keys: BTreeMap::new(), line_starts };
        if let Ok(table) = DeTable::parse(text) {
            places.add_table("", table.get_ref());
        }
        places
    }

    fn add_table(&mut self, path: &str, table: &DeTable<'_>) {
        for (key, value) in table {
            let dot = if path.is_empty() { "" } else { "." };
            let path = format!("{path}{dot}{}", key.get_ref());
            let place = Place { key: key.span(), value: value.span() };
            self.keys.insert(path.clone(), place);
            self.add_value(&path, value.get_ref());
        }
    }

    fn add_value(&mut self, path: &str, value: &DeValue<'_>) {
        match value {
            DeValue::Table(table) => self.add_table(path, table),
            DeValue::Array(items) => {
                for (n, item) in items.iter().enumerate() {
                    let path = format!("{path}[{n}]");
                    let place = Place { key: item.span(), value: item.span() };
                    self.keys.insert(path.clone(), place);
                    self.add_value(&path, item.get_ref());
                }
            }
            _ => {}
        }
    }

    /// Path of the innermost key at a position of the text; empty when there is none.
    pub fn path_at(&self, position: usize) -> &str {
        let spans =
            self.keys.iter().flat_map(|(path, place)| [(path, &place.key), (path, &place.value)]);
        let around = spans.filter(|(_, span)| span.contains(&position));
        // Of equal spans the longer path is the inner one.
        let innermost = around.min_by_key(|(path, span)| (span.len(), usize::MAX - path.len()));
        innermost.map_or("", |(path, _)| path)
    }

    /// Line (from 1) of a position of the text.
    pub fn line_at(&self, position: usize) -> usize {
        self.line_starts.partition_point(|start| *start <= position)
    }

    /// Line (from 1) of a key, or of the nearest table around it; `None` when it is not written.
    pub fn line_of(&self, path: &str) -> Option<usize> {
        let mut path = path;
        loop {
            if let Some(place) = self.keys.get(path) {
                return Some(self.line_at(place.key.start));
            }
            path = &path[..path.rfind(['.', '['])?];
        }
    }
}
