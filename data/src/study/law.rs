//! Constitutive laws by name, and the constants that each has besides its moduli.

use serde::{Deserialize, Serialize};

/// A constitutive law by name.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LawName {
    /// Isochoric neo-Hookean (Mîra 2018, eq. 2.37).
    #[default]
    NeoHookean,
    /// Mooney-Rivlin (Mîra 2018, eq. 2.38); needs `second_share`.
    MooneyRivlin,
    /// Gent (Mîra 2018, eq. 2.39); needs `jm`.
    Gent,
    /// Ogden (Mîra 2018, eq. 2.40); needs `terms`.
    Ogden,
    /// Yeoh (Mîra 2018, eq. 2.41); needs `ratios`.
    Yeoh,
    /// Hooke's law in logarithmic strain (Mîra 2018, eq. 2.33).
    Linear,
    /// Exponential elastic (Mîra 2018, eq. 2.35); needs `exponent`.
    Exponential,
}

impl LawName {
    /// As in a study file.
    pub fn name(self) -> &'static str {
        match self {
            Self::NeoHookean => "neo_hookean",
            Self::MooneyRivlin => "mooney_rivlin",
            Self::Gent => "gent",
            Self::Ogden => "ogden",
            Self::Yeoh => "yeoh",
            Self::Linear => "linear",
            Self::Exponential => "exponential",
        }
    }

    /// Key of the constant that the law needs.
    fn constant(self) -> Option<&'static str> {
        match self {
            Self::NeoHookean | Self::Linear => None,
            Self::MooneyRivlin => Some("constants.second_share"),
            Self::Gent => Some("jm"),
            Self::Ogden => Some("constants.terms"),
            Self::Yeoh => Some("constants.ratios"),
            Self::Exponential => Some("constants.exponent"),
        }
    }
}

/// Constants of the laws; each law but Gent's, whose `jm` stands beside it, has its own here. None
/// has a unit: a law is scaled by Young's modulus.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LawConstants {
    /// Mooney-Rivlin: μ₂/(μ₁ + μ₂), from 0 to 1.
    pub second_share: Option<f64>,
    /// Yeoh: c₂/c₁ and c₃/c₁.
    pub ratios: Option<[f64; 2]>,
    /// Ogden: share of the shear modulus and exponent of each term.
    pub terms: Option<OgdenTerms>,
    /// Exponential elastic: m.
    pub exponent: Option<f64>,
}

/// A constant that is missing, impossible, or of another law.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key}: {why}")]
pub struct BadConstant {
    /// Its key, beside the law's name.
    pub key: &'static str,
    /// What is wrong, and the remedy.
    pub why: String,
}

impl LawConstants {
    /// Refuses constants that do not make the law called `name`; `jm` is Gent's.
    ///
    /// # Errors
    /// The first one that is missing, impossible, or of another law.
    pub fn check(&self, name: LawName, jm: Option<f64>) -> Result<(), BadConstant> {
        let given = [
            ("jm", jm.is_some()),
            ("constants.second_share", self.second_share.is_some()),
            ("constants.ratios", self.ratios.is_some()),
            ("constants.terms", self.terms.is_some()),
            ("constants.exponent", self.exponent.is_some()),
        ];
        let own = name.constant();
        for (key, given) in given {
            let law = name.name();
            let short = key.trim_start_matches("constants.");
            if given && own != Some(key) {
                let why = format!("the law {law:?} has none; remove it or name another law");
                return Err(BadConstant { key, why });
            }
            if !given && own == Some(key) {
                let example = match name {
                    LawName::Ogden => "[[1.0, 2.0]]",
                    LawName::Yeoh => "[0.5, 0.1]",
                    LawName::MooneyRivlin => "0.2",
                    _ => "2.0",
                };
                let why = format!("missing; the law {law:?} needs {short}, such as {example}");
                return Err(BadConstant { key, why });
            }
        }
        let within = |key, value: Option<f64>, low: f64, high: f64| match value {
            Some(value) if !(value >= low && value <= high) => {
                let why = format!("{value} cannot be meant; write a number from {low} to {high}");
                Err(BadConstant { key, why })
            }
            _ => Ok(()),
        };
        within("jm", jm, 0.01, 1e6)?;
        within("constants.second_share", self.second_share, 0.0, 1.0)?;
        within("constants.exponent", self.exponent, 1e-3, 100.0)?;
        if let Some([second, third]) = self.ratios {
            // 1 + 2 c₂ x + 3 c₃ x² must stay positive for every x >= 0.
            let stiff = (0.0..=1e6).contains(&third) && second <= 1e6;
            if !(stiff && second > -(3.0 * third).sqrt().max(f64::MIN_POSITIVE)) {
                let why = format!(
                    "[{second}, {third}] lets tissue soften to nothing; write a second number of \
                     at least 0, and a first one above -sqrt(3 * second)"
                );
                return Err(BadConstant { key: "constants.ratios", why });
            }
        }
        Ok(())
    }
}

/// One to three terms of an Ogden law: share of the shear modulus, and exponent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[f64; 2]>", into = "Vec<[f64; 2]>")]
pub struct OgdenTerms {
    terms: [[f64; 2]; 3],
    count: usize,
}

impl OgdenTerms {
    /// The terms: shares are positive and sum to 1, exponents are not zero.
    pub fn list(&self) -> &[[f64; 2]] {
        &self.terms[..self.count]
    }
}

impl TryFrom<Vec<[f64; 2]>> for OgdenTerms {
    type Error = String;

    fn try_from(list: Vec<[f64; 2]>) -> Result<Self, String> {
        let mut terms = [[0.0; 2]; 3];
        if list.is_empty() || list.len() > terms.len() {
            return Err(format!("{} terms; give one to three of [share, exponent]", list.len()));
        }
        for [share, exponent] in &list {
            if !(*share > 0.0 && exponent.abs() >= 0.1 && exponent.abs() <= 50.0) {
                return Err(format!(
                    "the term [{share}, {exponent}] cannot be meant; write a share above 0 and an \
                     exponent of size 0.1 to 50"
                ));
            }
        }
        let sum: f64 = list.iter().map(|[share, _]| share).sum();
        if (sum - 1.0).abs() > 1e-6 {
            return Err(format!("the shares sum to {sum}; let them sum to 1"));
        }
        terms[..list.len()].copy_from_slice(&list);
        Ok(Self { terms, count: list.len() })
    }
}

impl From<OgdenTerms> for Vec<[f64; 2]> {
    fn from(terms: OgdenTerms) -> Self {
        terms.list().to_vec()
    }
}
