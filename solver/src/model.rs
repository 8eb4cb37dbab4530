//! A model: nodes, and a list of terms that act on them.

use crate::assemble::Analyses;
use crate::terms::Term;
use mammotwin_data::{Vec3, mesh::TetMesh};
use std::collections::BTreeMap;

/// Why a model cannot be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// A list does not match the mesh.
    #[error("{term}: {got} {what} for {wanted} elements; give one for each")]
    Count {
        /// Name of the term.
        term: String,
        /// What is counted.
        what: &'static str,
        /// Number of elements.
        wanted: usize,
        /// Number given.
        got: usize,
    },
    /// An element without size at rest.
    #[error("{term}: element {element} has size {size:.3e} at rest; improve the mesh")]
    Flat {
        /// Name of the term.
        term: String,
        /// The element.
        element: usize,
        /// Its volume (mm³) or area (mm²).
        size: f64,
    },
    /// A thickness that is not positive.
    #[error("{term}: thickness {thickness} mm on face {element}; give a positive one")]
    Thickness {
        /// Name of the term.
        term: String,
        /// The face.
        element: usize,
        /// Thickness (mm).
        thickness: f64,
    },
    /// A number without meaning.
    #[error("{term}: {what} of {value}; {remedy}")]
    Value {
        /// Name of the term.
        term: String,
        /// What it is, with its unit.
        what: &'static str,
        /// The number.
        value: f64,
        /// What to do.
        remedy: &'static str,
    },
    /// A node that does not exist.
    #[error("{term}: node {node} of {nodes}; use the nodes of the mesh")]
    NoSuchNode {
        /// Name of the term.
        term: String,
        /// The node.
        node: u32,
        /// Number of nodes.
        nodes: usize,
    },
    /// A free node without tissue.
    #[error("node {node} at {place:?} mm belongs to no tissue; remove or fix it")]
    Loose {
        /// The node.
        node: usize,
        /// Where it is (mm).
        place: [f64; 3],
    },
    /// A term that acts on nothing.
    #[error("{0}: no element, face or node; give it some, or leave it out")]
    Empty(String),
    /// A node without a place.
    #[error("node {node} is at {place:?} mm at rest; give it finite coordinates")]
    NotFinite {
        /// The node.
        node: usize,
        /// Where it is (mm).
        place: [f64; 3],
    },
    /// A part of the body that may move as a rigid one.
    #[error(
        "nothing holds the body against {motions} of {of} rigid motions of its {nodes} nodes around node {node} \
         at {place:?} mm; fix more of its nodes, or tie it by cables or a contact: one without friction holds along its normal"
    )]
    Unheld {
        /// Independent motions that nothing resists.
        motions: usize,
        /// Independent motions that there are.
        of: usize,
        /// Number of nodes that move along.
        nodes: usize,
        /// The first of them.
        node: usize,
        /// Where it is (mm).
        place: [f64; 3],
    },
    /// A plate that begins inside of the body.
    #[error(
        "{term}: begins {depth_mm:.1} mm inside of the skin (node {node}), more than half of the {thickness_mm} mm between \
         the plates; begin with them farther apart"
    )]
    Overlap {
        /// Name of the plate.
        term: String,
        /// The node that lies deepest in it.
        node: u32,
        /// How deep (mm).
        depth_mm: f64,
        /// Distance of the plates (mm).
        thickness_mm: f64,
    },
    /// Two terms of one name.
    #[error("two terms are named {0}; give each its own name")]
    SameName(String),
}

/// The body and everything that acts on it.
pub struct Model {
    /// Node positions at rest (mm).
    pub rest: Vec<Vec3>,
    terms: Vec<Box<dyn Term>>,
    fixed: Vec<[bool; 3]>,
    held: BTreeMap<u32, Vec3>,
    analyses: Analyses,
}

impl Model {
    /// A body without any term; its rest positions are those of the mesh.
    pub fn new(mesh: &TetMesh) -> Self {
        Self {
            rest: mesh.points.clone(),
            terms: Vec::new(),
            fixed: vec![[false; 3]; mesh.points.len()],
            held: BTreeMap::new(),
            analyses: Analyses::default(),
        }
    }

    /// Lets models with the same elements and fixed nodes be analysed once. Results are the same bits.
    pub fn share(&mut self, analyses: &Analyses) {
        self.analyses = analyses.clone();
    }

    /// Where its analysis is kept.
    pub(crate) fn analyses(&self) -> &Analyses {
        &self.analyses
    }

    /// Adds a term.
    ///
    /// # Errors
    /// A second term of the same name, a term without elements, or one on nodes that the mesh has not.
    pub fn add(&mut self, term: impl Term + 'static) -> Result<(), ModelError> {
        if self.terms.iter().any(|other| other.name() == term.name()) {
            return Err(ModelError::SameName(term.name().into()));
        }
        if term.elements() == 0 {
            return Err(ModelError::Empty(term.name().into()));
        }
        for &node in (0..term.elements()).flat_map(|e| term.nodes(e)) {
            let nodes = self.rest.len();
            if node as usize >= nodes {
                return Err(ModelError::NoSuchNode { term: term.name().into(), node, nodes });
            }
        }
        self.terms.push(Box::new(term));
        Ok(())
    }

    /// Keeps a node where it starts, along one axis (0, 1, 2).
    ///
    /// # Panics
    /// When there is no such node or axis.
    pub fn fix(&mut self, node: u32, axis: usize) {
        self.fixed[node as usize][axis] = true;
    }

    /// Keeps a node where it starts.
    ///
    /// # Panics
    /// When there is no such node.
    pub fn fix_node(&mut self, node: u32) {
        self.fixed[node as usize] = [true; 3];
    }

    /// Keeps a node at a place (mm), wherever its rest and start positions are.
    ///
    /// # Panics
    /// When there is no such node.
    pub fn hold(&mut self, node: u32, place: Vec3) {
        self.fix_node(node);
        self.held.insert(node, place);
    }

    /// Where nodes are held (mm), by node.
    pub fn held(&self) -> &BTreeMap<u32, Vec3> {
        &self.held
    }

    /// The terms, in the order in which they were added.
    pub fn terms(&self) -> &[Box<dyn Term>] {
        &self.terms
    }

    /// Axes along which each node is kept.
    pub fn fixed(&self) -> &[[bool; 3]] {
        &self.fixed
    }
}
