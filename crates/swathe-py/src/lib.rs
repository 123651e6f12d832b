//! Python bindings of the core: `swathe._core`.
//!
//! Every function converts, releases the interpreter, calls the core and converts back. Public names, checks and
//! docstrings are Python's (`python/swathe`).

#![allow(clippy::needless_pass_by_value, reason = "PyO3 hands arguments over by value")]

mod belief;
mod convert;
mod drivable;
mod drive;
mod episode;
mod error;
mod events;
mod grids;
mod local;
mod nest;
mod planner;
mod progress;
mod rank;
mod region;
mod repair;
mod sim;
mod soil;
mod stop;
mod swarm;
mod terrain;
mod vehicle;

#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    use crate::belief::{
        SoilBelief, belief_classes, belief_defaults, check_reading, match_profile, next_probe, soil_types,
    };
    #[pymodule_export]
    use crate::drivable::{drivable_defaults, drivable_path, dubins, reeds_shepp};
    #[pymodule_export]
    use crate::drive::Navigator;
    #[pymodule_export]
    use crate::episode::Episode;
    #[pymodule_export]
    use crate::error::{error_kinds, raise_error};
    #[pymodule_export]
    use crate::grids::{OverlappingGrids, gap_share, gaps_found};
    #[pymodule_export]
    use crate::local::{PlayerVfh, VfhPlus};
    #[pymodule_export]
    use crate::nest::{exact_nests, nest_graph, outlines};
    #[pymodule_export]
    use crate::planner::{any_angle_path, cost_field, eikonal_field, lazy_astar, plan, shortest_path};
    #[pymodule_export]
    use crate::rank::{ahp, height_goodness, rank_cell, rank_map, reasons};
    #[pymodule_export]
    use crate::region::{Region, defaults};
    #[pymodule_export]
    use crate::repair::Replanner;
    #[pymodule_export]
    use crate::sim::{SimRobot, SimWorld, random_world, sick_lms200};
    #[pymodule_export]
    use crate::soil::{rating_cone_index_kpa, soil_goodness};
    #[pymodule_export]
    use crate::swarm::{merge_tiles, run_swarm, run_swarm_on_ranks, run_tile, tile_jobs, transitions};
    #[pymodule_export]
    use crate::terrain::{
        aspect_rad, block_max, directional_difference, group_mean, height_map, roughness_m, slope, squared_distances,
    };
    #[pymodule_export]
    use crate::vehicle::Vehicle;

    /// Version of the package.
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
