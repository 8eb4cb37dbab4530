//! Elimination order of the nodes: nested dissection, then a postorder of the elimination tree.

use std::sync::Mutex;

/// Neighbours of each node, as compressed rows without the diagonal, ascending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Graph {
    /// Start of each node's neighbours; one more than nodes.
    pub starts: Vec<usize>,
    /// Neighbours.
    pub neighbours: Vec<u32>,
}

impl Graph {
    /// The graph in which the nodes of each element are all connected.
    pub fn of_elements<'a>(nodes: usize, elements: impl Iterator<Item = &'a [u32]>) -> Self {
        let mut rows: Vec<Vec<u32>> = vec![Vec::new(); nodes];
        for element in elements {
            for &a in element {
                rows[a as usize].extend(element.iter().filter(|&&b| b != a));
            }
        }
        let mut starts = vec![0];
        let mut neighbours = Vec::new();
        for row in &mut rows {
            row.sort_unstable();
            row.dedup();
            neighbours.extend_from_slice(row);
            starts.push(neighbours.len());
        }
        Self { starts, neighbours }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is no node.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Neighbours of a node, ascending.
    pub fn row(&self, node: usize) -> &[u32] {
        &self.neighbours[self.starts[node]..self.starts[node + 1]]
    }
}

/// Nodes in the order in which they are best eliminated.
pub fn elimination_order(graph: &Graph) -> Vec<u32> {
    let order = nested_dissection(graph);
    let mut rank = vec![0u32; order.len()];
    for (position, &node) in order.iter().enumerate() {
        rank[node as usize] = position as u32;
    }
    postorder(&elimination_tree(graph, &order, &rank)).iter().map(|&p| order[p as usize]).collect()
}

/// METIS draws from the C library's generator: one caller at a time keeps it reproducible.
static METIS: Mutex<()> = Mutex::new(());

#[allow(unsafe_code)]
fn nested_dissection(graph: &Graph) -> Vec<u32> {
    let natural = || (0..graph.len() as u32).collect();
    if graph.neighbours.is_empty() {
        return natural();
    }
    let mut nodes = graph.len() as i32;
    let mut starts: Vec<i32> = graph.starts.iter().map(|&s| s as i32).collect();
    let mut neighbours: Vec<i32> = graph.neighbours.iter().map(|&n| n as i32).collect();
    let mut order = vec![0i32; graph.len()];
    let mut rank = vec![0i32; graph.len()];
    let _one_at_a_time = METIS.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    // SAFETY: all arrays have the lengths that METIS_NodeND documents, live through the call, and
    // are not kept; null weights and options mean the defaults.
    let status = unsafe {
        metis_sys::METIS_NodeND(
            &mut nodes,
            starts.as_mut_ptr(),
            neighbours.as_mut_ptr(),
            std::ptr::null_mut(),
            std::ptr::null_mut(),
            order.as_mut_ptr(),
            rank.as_mut_ptr(),
        )
    };
    // Without an answer (out of memory) any order is right, only slower.
    if status == 1 { order.iter().map(|&n| n as u32).collect() } else { natural() }
}

/// Parent of each position in the elimination tree; `u32::MAX` for roots (Liu 1990).
fn elimination_tree(graph: &Graph, order: &[u32], rank: &[u32]) -> Vec<u32> {
    let mut parent = vec![u32::MAX; order.len()];
    let mut ancestor = parent.clone();
    for (position, &node) in order.iter().enumerate() {
        for &neighbour in graph.row(node as usize) {
            let mut at = rank[neighbour as usize];
            while (at as usize) < position {
                let next = ancestor[at as usize];
                ancestor[at as usize] = position as u32;
                if next == u32::MAX {
                    parent[at as usize] = position as u32;
                    break;
                }
                at = next;
            }
        }
    }
    parent
}

/// Positions, children before parents, each subtree in one piece.
fn postorder(parent: &[u32]) -> Vec<u32> {
    let n = parent.len();
    let mut first_child = vec![u32::MAX; n];
    let mut next_sibling = vec![u32::MAX; n];
    let mut roots = Vec::new();
    for at in (0..n).rev() {
        match parent[at] {
            u32::MAX => roots.push(at as u32),
            p => {
                next_sibling[at] = first_child[p as usize];
                first_child[p as usize] = at as u32;
            }
        }
    }
    let mut order = Vec::with_capacity(n);
    let mut stack = roots;
    while let Some(&at) = stack.last() {
        let child = first_child[at as usize];
        if child == u32::MAX {
            order.push(at);
            stack.pop();
        } else {
            first_child[at as usize] = next_sibling[child as usize];
            stack.push(child);
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_node_is_eliminated_once() {
        let line: Vec<[u32; 2]> = (0..50).map(|n| [n, n + 1]).collect();
        let graph = Graph::of_elements(53, line.iter().map(|e| e.as_slice()));
        let mut order = elimination_order(&graph);
        assert_eq!(order, elimination_order(&graph));
        order.sort_unstable();
        assert_eq!(order, (0..53).collect::<Vec<u32>>());
    }
}
