//! The contact of the breast with the chest wall, region by region (Mîra 2018, § 3.4, appendix C).

use super::{Body, Recipe, ligaments::region};
use mammotwin_data::{
    Vec3,
    mesh::Patch,
    study::{InterfaceKind, InterfacePlan, InterfaceRegion, RegionPlan},
};
use mammotwin_solver::{
    model::{Model, ModelError},
    terms::{Gliding, Opening, Sliding, Slip},
};
use std::{collections::BTreeMap, sync::Arc};

/// Supports the body by the chest wall; slip counts from the stress-free shape `rest` (mm).
///
/// # Errors
/// A coefficient of friction without meaning.
pub(super) fn support(
    body: &Body,
    recipe: &Recipe,
    model: &mut Model,
    rest: &[Vec3],
) -> Result<(), ModelError> {
    let plan: &InterfacePlan = &recipe.interface;
    let reference = &body.mesh.points;
    let faces = body.mesh.patch(Patch::ChestWall);
    let own = |node: u32| part(body, plan, node);
    let mut nodes: BTreeMap<Option<InterfaceRegion>, Vec<u32>> = BTreeMap::new();
    for node in body.mesh.patch_nodes(Patch::ChestWall) {
        nodes.entry(own(node)).or_default().push(node);
    }
    for (part, nodes) in &nodes {
        let RegionPlan { kind, .. } = &plan.of(*part);
        let friction = Slip::Coulomb(plan.of(*part).coefficient());
        let (opening, slip) = match kind {
            // The muscle has these nodes, too.
            InterfaceKind::Bonded if body.muscle.is_some() => continue,
            InterfaceKind::Bonded => {
                for &node in nodes {
                    let place = &reference[node as usize];
                    model.hold(node, place + wall_shift(body, place, recipe.wall_shift_mm));
                }
                continue;
            }
            InterfaceKind::NoSeparation => (Opening::Never, friction),
            InterfaceKind::Rough => (Opening::Free, Slip::Never),
            InterfaceKind::Frictionless => (Opening::Free, Slip::Free),
            InterfaceKind::Frictional => (Opening::Free, friction),
        };
        let name = part.map_or("chest_wall".into(), |part| format!("chest_wall_{}", part.name()));
        if let Some(muscle) = body.muscle {
            let value = plan.of(*part).coefficient();
            if *kind != InterfaceKind::NoSeparation || value > 0.0 {
                return Err(ModelError::Value {
                    term: name,
                    what: "coefficient of friction, or a contact that may open, on a deformable muscle,",
                    value,
                    remedy: "glue the breast to it, let it slide without friction, or make the muscle rigid",
                });
            }
            let front = muscle.smooth_front(body, plan)?;
            model.add(Gliding::new(&name, faces, Arc::new(front), |node| own(node) == *part))?;
            continue;
        }
        let sliding = Sliding::new(&name, reference, faces, body.wall.clone())
            .opening(opening)
            .slip(slip, rest)?
            .without(|node| own(node) != *part);
        model.add(sliding)?;
    }
    Ok(())
}

/// The part of the interface that a node of the breast's rear belongs to: regions without a plan of their
/// own are one with what lies outside.
pub(super) fn part(body: &Body, plan: &InterfacePlan, node: u32) -> Option<InterfaceRegion> {
    region(body.anatomy, &body.mesh.points[node as usize]).filter(|r| plan.regions.contains_key(r))
}

/// How far (mm) a place of the chest wall stands out when it does so by `mm` behind the middle of each breast, less and less towards
/// the rims of their bases.
pub(super) fn wall_shift(body: &Body, place: &Vec3, mm: f64) -> Vec3 {
    match body.anatomy.nearest(place) {
        Some((base, radius)) => mm * (-radius * radius).exp() * base.normal,
        None => Vec3::zeros(),
    }
}
