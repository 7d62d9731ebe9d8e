//! Results printed in the paper.

use serde::{Deserialize, Serialize};

/// A table of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Published {
    /// Single view against multi-view
    Table1,
    /// With and without the view-adaptive loss
    Table2,
}

impl Published {
    /// The printed table in Markdown.
    pub fn markdown(self) -> &'static str {
        match self {
            Self::Table1 => TABLE_1,
            Self::Table2 => TABLE_2,
        }
    }
}

const TABLE_1: &str = "
# Table 1 of the paper, as printed (other objects: those of PAC-NeRF)

| object     | single view                                              | PAC-NeRF, multi-view                                     | truth                                     |
| ---------- | -------------------------------------------------------- | -------------------------------------------------------- | ----------------------------------------- |
| Droplet    | μ 218 Pa s, κ 0.120 MPa                                  | μ 209 Pa s, κ 0.108 MPa                                  | μ 200 Pa s, κ 0.1 MPa                     |
| Cream      | μ 195 kPa, κ 1.74 MPa, τ_Y 3.41 kPa, η 5.5 Pa s          | μ 121 kPa, κ 1.57 MPa, τ_Y 3.16 kPa, η 5.6 Pa s          | μ 10 kPa, κ 1 MPa, τ_Y 3 kPa, η 10 Pa s   |
| Toothpaste | μ 7.93 kPa, κ 0.266 MPa, τ_Y 247 Pa, η 9.50 Pa s         | μ 6.51 kPa, κ 0.222 MPa, τ_Y 228 Pa, η 9.77 Pa s         | μ 5 kPa, κ 0.1 MPa, τ_Y 200 Pa, η 10 Pa s |
| Torus      | E 1.52 MPa, ν 0.420 (*)                                  |                                                          | E 1 MPa, ν 0.3                            |
| Bird       | E 260 kPa, ν 0.261 (*)                                   |                                                          | E 300 kPa, ν 0.3                          |
| Playdoh    | E 5.14 MPa, ν 0.23, τ_Y 19.0 kPa (*)                     |                                                          | E 2 MPa, ν 0.3, τ_Y 15.4 kPa              |
| Cat        | E 131 kPa, ν 0.330, τ_Y 3.07 kPa (*)                     |                                                          | E 1 MPa, ν 0.3, τ_Y 3.85 kPa              |
| Trophy     | θ_fric 33.5°                                             | θ_fric 36.1°                                             | θ_fric 40°                                |

(*) from its table 2, with L_va
";

const TABLE_2: &str = "
# Table 2 of the paper, as printed (single view; other objects: those of PAC-NeRF)

| object     | with L_va                                       | without L_va                                      |
| ---------- | ----------------------------------------------- | ------------------------------------------------- |
| Droplet    | μ 218 Pa s, κ 0.120 MPa                         | μ 427 Pa s, κ 1.82 (no power of ten is printed)   |
| Cream      | μ 195 kPa, κ 1.74 MPa, τ_Y 3.41 kPa, η 5.5 Pa s | fails to converge                                 |
| Toothpaste | μ 7.93 kPa, κ 0.266 MPa, τ_Y 247 Pa, η 9.5 Pa s | μ 12.3 kPa, κ 4.39 (so), τ_Y 136 Pa, η 8.53 Pa s  |
| Torus      | E 1.52 MPa, ν 0.420                             | fails to converge                                 |
| Bird       | E 260 kPa, ν 0.261                              | E 244 kPa, ν 0.183                                |
| Playdoh    | E 5.14 MPa, ν 0.23, τ_Y 19.0 kPa                | E 7.29 MPa, ν 0.22, τ_Y 22.8 kPa                  |
| Cat        | E 131 kPa, ν 0.330, τ_Y 3.07 kPa                | E 96 kPa, ν 0.13, τ_Y 2.75 kPa                    |
";
