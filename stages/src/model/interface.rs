//! The contact of the breast with the chest wall, region by region (Mîra 2018, § 3.4, appendix C).

use super::{Body, ligaments::region};
use mammotwin_data::{
    Vec3,
    mesh::Patch,
    study::{InterfaceKind, InterfacePlan, InterfaceRegion, RegionPlan},
};
use mammotwin_solver::{
    model::{Model, ModelError},
    terms::{Opening, Sliding, Slip},
};
use std::collections::BTreeMap;

/// Supports the body by the chest wall; slip counts from the stress-free shape `rest` (mm).
///
/// # Errors
/// A coefficient of friction without meaning.
pub(super) fn support(
    body: &Body,
    plan: &InterfacePlan,
    model: &mut Model,
    rest: &[Vec3],
) -> Result<(), ModelError> {
    let reference = &body.mesh.points;
    let faces = body.mesh.patch(Patch::ChestWall);
    // Regions without a plan of their own are one with what lies outside.
    let own = |node: u32| -> Option<InterfaceRegion> {
        region(body.anatomy, &reference[node as usize]).filter(|r| plan.regions.contains_key(r))
    };
    let mut nodes: BTreeMap<Option<InterfaceRegion>, Vec<u32>> = BTreeMap::new();
    for node in body.mesh.patch_nodes(Patch::ChestWall) {
        nodes.entry(own(node)).or_default().push(node);
    }
    for (part, nodes) in &nodes {
        let RegionPlan { kind, .. } = plan.of(*part);
        let friction = Slip::Coulomb(plan.of(*part).coefficient());
        let (opening, slip) = match kind {
            InterfaceKind::Bonded => {
                nodes.iter().for_each(|&n| model.hold(n, reference[n as usize]));
                continue;
            }
            InterfaceKind::NoSeparation => (Opening::Never, friction),
            InterfaceKind::Rough => (Opening::Free, Slip::Never),
            InterfaceKind::Frictionless => (Opening::Free, Slip::Free),
            InterfaceKind::Frictional => (Opening::Free, friction),
        };
        let name = part.map_or("chest_wall".into(), |part| format!("chest_wall_{}", part.name()));
        let sliding = Sliding::new(&name, reference, faces, body.wall.clone())
            .opening(opening)
            .slip(slip, rest)?
            .without(|node| own(node) != *part);
        model.add(sliding)?;
    }
    Ok(())
}
