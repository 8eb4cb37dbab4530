//! Labels with numbers of their own to the labels of this program.

use mammotwin_data::{
    Failure,
    labels::{LabelMap, RawLabels, Tissue},
    progress::Progress,
    store::Stage,
    study::LabelName,
};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Gives the numbers of finished labels their meaning.
#[derive(Debug, Clone, Serialize)]
pub struct Relabel {
    /// What each number is; 0 is background unless it is named.
    pub map: BTreeMap<String, LabelName>,
}

impl Stage for Relabel {
    const NAME: &'static str = "relabel";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "";
    type Input = RawLabels;
    type Output = LabelMap;

    fn run(&self, labels: &RawLabels, _: &dyn Progress) -> Result<LabelMap, Failure> {
        relabelled(labels, &self.map).map_err(Failure::BadInput)
    }
}

/// Labels of tissues; in words which values the map does not name.
pub fn relabelled(
    RawLabels(labels): &RawLabels,
    map: &BTreeMap<String, LabelName>,
) -> Result<LabelMap, String> {
    let mut names: BTreeMap<u16, LabelName> = BTreeMap::from([(0, LabelName::Background)]);
    for (number, name) in map {
        let number = number.parse().map_err(|_| format!("label_map: {number:?} is no label"))?;
        names.insert(number, *name);
    }
    let there: BTreeSet<u16> = labels.values.iter().copied().collect();
    let unknown: Vec<String> =
        there.iter().filter(|n| !names.contains_key(n)).map(u16::to_string).collect();
    if !unknown.is_empty() {
        let unknown = unknown.join(", ");
        return Err(format!("labels: label_map does not name {unknown}; name every value"));
    }
    let mut table = vec![LabelName::Background; usize::from(u16::MAX) + 1];
    for (number, name) in &names {
        table[usize::from(*number)] = *name;
    }
    let grid = &labels.grid;
    let x = |n: usize| grid.center(grid.voxel(n)).x;
    let name = |n: usize| table[usize::from(labels.values[n])];
    // The middle of the chest wall; of all there is, when that is not labelled.
    let mean = |of: &dyn Fn(Tissue) -> bool| {
        let own = (0..grid.len()).filter(|&n| of(name(n).tissue(true)));
        let (sum, count) = own.fold((0.0, 0.0), |(sum, count), n| (sum + x(n), count + 1.0));
        (count > 0.0).then_some(sum / count)
    };
    let middle = mean(&Tissue::is_chest_wall)
        .or_else(|| mean(&|tissue| tissue != Tissue::Background))
        .unwrap_or(0.0);
    let values = (0..grid.len()).map(|n| name(n).tissue(x(n) >= middle)).collect();
    Ok(LabelMap { grid: grid.clone(), values })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::{
        Vec3,
        volume::{Grid, Volume},
    };

    #[test]
    fn numbers_get_names_and_sides_and_unknown_ones_are_told() {
        let grid = Grid::aligned([3, 2, 1], [-10.0, 10.0, 10.0], Vec3::new(110.0, 0.0, 0.0));
        let raw = RawLabels(Volume { grid: grid.clone(), values: vec![1, 0, 1, 300, 300, 2] });
        let map = |pairs: &[(&str, LabelName)]| {
            pairs.iter().map(|(n, name)| ((*n).to_string(), *name)).collect::<BTreeMap<_, _>>()
        };
        let known = map(&[
            ("1", LabelName::Adipose),
            ("2", LabelName::FibroglandularLeft),
            ("300", LabelName::PectoralMuscle),
        ]);
        use Tissue::*;
        // The muscle lies at x = 110 and 100 mm: its middle is 105.
        let values = vec![
            AdiposeRight,
            Background,
            AdiposeLeft,
            PectoralMuscle,
            PectoralMuscle,
            FibroglandularLeft,
        ];
        assert_eq!(relabelled(&raw, &known), Ok(LabelMap { grid, values }));
        let few = map(&[("1", LabelName::Adipose)]);
        let said = relabelled(&raw, &few).unwrap_err();
        assert!(said.contains("does not name 2, 300"), "{said}");
    }
}
