//! What the thesis prints of its two studies (Mîra 2018, § 5.4), for orientation: other persons, forces
//! and tissues.

use mammotwin_data::tables;

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Study {
    /// § 5.4.1: rigid against flex.
    Paddles,
    /// § 5.4.2: distance from the chest wall to an elastic paddle.
    Positions,
}

impl Study {
    /// Headings and rows of its table.
    pub fn table(self) -> (Vec<String>, Vec<Vec<String>>) {
        let words = |row: &[&str]| row.iter().map(ToString::to_string).collect::<Vec<String>>();
        match self {
            Self::Paddles => {
                let head = [
                    "volunteer",
                    "paddle",
                    "thickness (mm)",
                    "AGD (mGy)",
                    "SNR",
                    "SDNR 200 µm",
                    "SDNR 300 µm",
                    "largest pressure (kPa)",
                ];
                let peak = |volunteer: &str, paddle: &str| match (volunteer, paddle) {
                    ("2", "rigid") => "56",
                    ("2", "flex") => "37",
                    _ => "77.7 (both paddles)",
                };
                let rows = tables::rows(tables::THESIS_5_10).map(|row| {
                    let pressure = peak(row[0], row[1]);
                    words(&[row[0], row[1], row[2], row[3], row[4], row[6], row[8], pressure])
                });
                (words(&head), rows.collect())
            }
            Self::Positions => {
                let head = [
                    "chest wall to paddle (mm)",
                    "force (N)",
                    "pressure near the chest wall (kPa)",
                    "pressure on the breast (kPa)",
                ];
                let rows = [["48", "59"], ["40", "94"], ["33", "158"]];
                let rows = rows.map(|[mm, n]| words(&[mm, n, "about 90", "about 10"]));
                (words(&head), rows.into())
            }
        }
    }

    /// What to know of these numbers.
    pub fn caption(self) -> &'static str {
        match self {
            Self::Paddles => {
                "Mîra (2018), table 5.10 and § 5.4.1: volunteer 1 (small) at 22 N, volunteer 2 (large) \
                 at 95 N. Flex against rigid there: dose -2.6 and -4.2 %, SNR p 0.706 and below 0.001, \
                 tissue up to 4 mm nearer to the chest wall (large). Dustler et al. (2021), 15 women, CC: \
                 22 % of the force rests on the breast under a rigid plate, 36 % under a flexible one."
            }
            Self::Positions => {
                "Mîra (2018), § 5.4.2: volunteer 2, right breast, elastic paddle, to 50 mm. The force rises \
                 by a factor of 2.7 from 48 to 33 mm."
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_complete() {
        for (study, rows) in [(Study::Paddles, 4), (Study::Positions, 3)] {
            let (head, body) = study.table();
            assert_eq!(body.len(), rows);
            assert!(body.iter().all(|row| row.len() == head.len()));
        }
        let (_, body) = Study::Paddles.table();
        assert_eq!(body[3][1..5], ["flex", "46", "1.15", "137.21"]);
    }
}
