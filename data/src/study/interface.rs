//! What happens between breast and muscle, region by region.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What happens between two surfaces (Mîra 2018, table 2.1).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum InterfaceKind {
    /// Slides against friction, but never lifts off.
    #[default]
    NoSeparation,
    /// Glued.
    Bonded,
    /// May lift off, but does not slide where it is pressed on.
    Rough,
    /// May lift off, and slides freely.
    Frictionless,
    /// May lift off, and slides against friction where it is pressed on.
    Frictional,
}

impl InterfaceKind {
    /// As in a study file.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoSeparation => "no_separation",
            Self::Bonded => "bonded",
            Self::Rough => "rough",
            Self::Frictionless => "frictionless",
            Self::Frictional => "frictional",
        }
    }

    /// Whether it has a coefficient of friction.
    pub fn has_friction(self) -> bool {
        matches!(self, Self::NoSeparation | Self::Frictional)
    }
}

/// A region of the interface by the breast's base, on the same side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum InterfaceRegion {
    /// Under the breast, within its rim.
    Base,
    /// The rim along the inframammary fold.
    Inframammary,
    /// The rim along the sternum.
    DeepMedial,
    /// The upper rim.
    Cranial,
    /// The lateral rim.
    Lateral,
}

impl InterfaceRegion {
    /// As in a study file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Inframammary => "inframammary",
            Self::DeepMedial => "deep_medial",
            Self::Cranial => "cranial",
            Self::Lateral => "lateral",
        }
    }
}

/// What happens in one region of the interface.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionPlan {
    /// Contact law.
    pub kind: InterfaceKind,
    /// Coulomb friction coefficient, of kinds that have one; 0.1 when not given.
    pub friction: Option<f64>,
}

/// Coefficient of friction between breast and muscle (Mîra 2018, § 3.4).
const FRICTION: f64 = 0.1;

impl RegionPlan {
    /// Coulomb friction coefficient; zero for kinds without one.
    pub fn coefficient(&self) -> f64 {
        if self.kind.has_friction() { self.friction.unwrap_or(FRICTION) } else { 0.0 }
    }
}

/// What happens between breast and muscle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InterfacePlan {
    /// Contact law wherever `regions` says nothing else.
    pub kind: InterfaceKind,
    /// Coulomb friction coefficient, of kinds that have one; 0.1 when not given.
    pub friction: Option<f64>,
    /// Regions that are unlike the rest (Mîra 2018, appendix C).
    pub regions: BTreeMap<InterfaceRegion, RegionPlan>,
}

impl InterfacePlan {
    /// The same everywhere.
    pub fn uniform(kind: InterfaceKind, friction: Option<f64>) -> Self {
        Self { kind, friction, regions: BTreeMap::new() }
    }

    /// What happens in a region, or outside of all of them.
    pub fn of(&self, region: Option<InterfaceRegion>) -> RegionPlan {
        let own = region.and_then(|region| self.regions.get(&region));
        own.copied().unwrap_or(RegionPlan { kind: self.kind, friction: self.friction })
    }

    /// Whether nothing can slide or lift off.
    pub fn is_bonded(&self) -> bool {
        let bonded = |plan: &RegionPlan| plan.kind == InterfaceKind::Bonded;
        bonded(&self.of(None)) && self.regions.values().all(bonded)
    }
}
