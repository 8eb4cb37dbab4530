//! Sparsity of a symmetric matrix.

/// Lower triangle, diagonal included, of a symmetric sparsity, as compressed columns with
/// ascending rows.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Pattern {
    /// Start of each column; one more than columns.
    pub starts: Vec<usize>,
    /// Rows.
    pub rows: Vec<usize>,
}

impl Pattern {
    /// Number of unknowns.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is no unknown.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Position of an entry among the values; row >= column.
    pub fn position(&self, row: usize, column: usize) -> Option<usize> {
        let (start, end) = (self.starts[column], self.starts[column + 1]);
        self.rows[start..end].binary_search(&row).ok().map(|at| start + at)
    }

    /// The same entries as an upper triangle in compressed columns.
    pub(super) fn transposed(&self) -> Self {
        let mut starts = vec![0; self.starts.len()];
        for &row in &self.rows {
            starts[row + 1] += 1;
        }
        for n in 1..starts.len() {
            starts[n] += starts[n - 1];
        }
        let mut next = starts.clone();
        let mut rows = vec![0; self.rows.len()];
        for column in 0..self.len() {
            for &row in &self.rows[self.starts[column]..self.starts[column + 1]] {
                rows[next[row]] = column;
                next[row] += 1;
            }
        }
        Self { starts, rows }
    }

    /// `y` = A `x`, with the symmetric matrix of these lower `values`.
    pub(super) fn multiply(&self, values: &[f64], x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for column in 0..self.len() {
            let mut sum = 0.0;
            for at in self.starts[column]..self.starts[column + 1] {
                let row = self.rows[at];
                y[row] += values[at] * x[column];
                if row != column {
                    sum += values[at] * x[row];
                }
            }
            y[column] += sum;
        }
    }

    /// Row and column of each entry.
    pub(super) fn entries(&self) -> impl Iterator<Item = (usize, usize)> {
        let column = |n: usize| {
            self.rows[self.starts[n]..self.starts[n + 1]].iter().map(move |&row| (row, n))
        };
        (0..self.len()).flat_map(column)
    }

    /// Powers of two that bring the diagonal of the matrix of these `values` near to one when rows and columns are
    /// multiplied with them; one where it has none.
    pub(super) fn scale(&self, values: &[f64], scale: &mut Vec<f64>) {
        scale.clear();
        scale.extend(self.starts[..self.len()].iter().map(|&diagonal| {
            let size = values[diagonal].abs().log2();
            if size.is_finite() { (-0.5 * size).round().exp2() } else { 1.0 }
        }));
    }
}
