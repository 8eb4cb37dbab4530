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

    /// Where a key is written, or else the nearest table around it; `None` when neither is.
    pub fn span_of(&self, path: &str) -> Option<Range<usize>> {
        let mut path = path;
        loop {
            if let Some(place) = self.keys.get(path) {
                return Some(place.key.clone());
            }
            path = &path[..path.rfind(['.', '['])?];
        }
    }

    /// The line of a piece of the text, with its number, and marks under the piece.
    pub fn excerpt(&self, text: &str, span: Range<usize>) -> String {
        let line = self.line_at(span.start);
        let begin = self.line_starts[line - 1];
        let words = text[begin..].lines().next().unwrap_or_default();
        // Columns count characters; a tab stays one, so that marks stay under it.
        let inside = |at: usize| at.clamp(begin, begin + words.len()) - begin;
        let (from, to) = (inside(span.start), inside(span.end));
        let pad: String =
            words[..from].chars().map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
        let marks = "^".repeat(words[from..to].chars().count().max(1));
        let number = line.to_string();
        let margin = " ".repeat(number.len());
        format!("{margin} |\n{number} | {words}\n{margin} | {pad}{marks}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_excerpt_marks_the_key_on_its_line() {
        let text = "schema = 1\n[model.skin]\n\tyoung_kpa = -3.0 # µ\n";
        let places = Places::of(text);
        let span = places.span_of("model.skin.young_kpa").unwrap();
        let want = "  |\n3 | \tyoung_kpa = -3.0 # µ\n  | \t^^^^^^^^^";
        assert_eq!(places.excerpt(text, span), want);
        // What is not written is the business of the table around it.
        let span = places.span_of("model.skin.thickness_mm").unwrap();
        assert!(places.excerpt(text, span).ends_with("2 | [model.skin]\n  |        ^^^^"));
        // Positions at and beyond the end of a text.
        for at in [text.len(), text.len() - 1] {
            assert!(places.excerpt(text, at..at).contains('^'));
        }
    }
}
