//! One number of the report.

/// A named value, with the thesis' value beside it where the thesis has one.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Metric {
    /// Machine name with its unit: `peak_pressure_kpa`.
    pub name: String,
    /// What it says, in words.
    pub long_name: String,
    /// Unit; empty for a pure number.
    pub unit: String,
    /// The value.
    pub value: f64,
    /// One standard deviation of the value, where what it rests on has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// Value of Mîra (2018), for orientation; another person and another model.
    pub thesis: Option<f64>,
    /// Where it comes from: an equation, a table.
    pub source: String,
}

impl Metric {
    /// A metric that the thesis has no value for.
    pub fn new(name: &str, long_name: &str, unit: &str, value: f64, source: &str) -> Self {
        Self {
            name: name.into(),
            long_name: long_name.into(),
            unit: unit.into(),
            value,
            sd: None,
            thesis: None,
            source: source.into(),
        }
    }

    /// The same metric beside the value that the thesis reports.
    pub fn beside(mut self, thesis: f64) -> Self {
        self.thesis = Some(thesis);
        self
    }
}
