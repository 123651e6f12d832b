//! The states that agents and nests go through, noted in tests and nowhere else.

use std::collections::HashMap;

use crate::grid::Cell;

use super::{State, flag};

/// The way through the flow charts, turn by turn.
#[derive(Default)]
pub(super) struct Trace {
    /// Always empty outside tests.
    turns: Vec<Vec<State>>,
    /// Turns of foci that are examined side by side; always empty outside tests.
    foci: HashMap<Cell, Vec<State>>,
}

impl Trace {
    /// Begins the turn of an agent or of a focus.
    pub(super) fn begin(&mut self, state: State) {
        if cfg!(test) {
            self.turns.push(vec![state]);
        }
    }

    /// Begins an agent's turn with how it comes to its cell; `None` when it was drawn outside the swathe.
    pub(super) fn arrive(&mut self, tick: u64, arrival: Option<State>) {
        match arrival {
            Some(State::Deploy) if tick == 0 => self.begin(State::Deploy),
            _ => self.begin(State::Forage),
        }
        self.enter_if(tick > 0 && arrival == Some(State::Deploy), State::Deploy);
        self.enter(arrival.map_or(State::Forage, |_| State::Look));
    }

    /// Goes on with the turn.
    pub(super) fn enter(&mut self, state: State) {
        if cfg!(test)
            && let Some(turn) = self.turns.last_mut()
        {
            turn.push(state);
        }
    }

    /// Goes on with the turn where `whether` holds.
    pub(super) fn enter_if(&mut self, whether: bool, state: State) {
        if whether {
            self.enter(state);
        }
    }

    /// Goes on with the turn of a focus.
    pub(super) fn enter_at(&mut self, focus: Cell, state: State) {
        if cfg!(test) {
            self.foci.entry(focus).or_default().push(state);
        }
    }

    /// Ends the turn of a focus that is rejected, or was a core already.
    pub(super) fn leave_if(&mut self, flags: u8, focus: Cell) {
        if !cfg!(test) || flags & (flag::DEAD | flag::CORE) == 0 {
            return;
        }
        if flags & flag::DEAD > 0 {
            self.enter_at(focus, State::Reject);
        }
        self.enter_at(focus, State::Forage);
        self.turns.extend(self.foci.remove(&focus));
    }

    /// Goes on with the turn of a focus by itself.
    pub(super) fn take_up(&mut self, focus: Cell, state: State) {
        if cfg!(test) {
            self.turns.extend(self.foci.remove(&focus));
            self.enter(state);
        }
    }

    /// Ends the swarm.
    pub(super) fn finish(&mut self) {
        self.begin(State::Forage);
        self.enter(State::Done);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::super::Colony;
    use super::*;
    use crate::grid::{GridGeometry, Layer};
    use crate::nest::{Contact, NestParams, Vicinity};
    use crate::progress::silent;
    use crate::rank::RankMap;
    use crate::swarm::transitions::{Chart, TRANSITIONS};
    use crate::swarm::{Explore, SwarmParams};

    /// Every transition that swarms of all kinds make on ground with holes, widened and taken up again.
    fn made() -> HashSet<(Chart, State, State)> {
        let geometry = GridGeometry::new(16, 24, 1.0, 0.0, 0.0).unwrap();
        let mut made = HashSet::new();
        for (seed, explore) in (0..).zip([Explore::Walk, Explore::Uniform, Explore::Permute]) {
            for (pellet_max, contact, vicinity) in [
                (1, Contact::Edge, Vicinity::Cell),
                (3, Contact::Overlap, Vicinity::Moore1),
                (2, Contact::Corner, Vicinity::Moore1),
            ] {
                let ranks = (0..16 * 24).map(|i| {
                    let hole = crate::random::philox([i, 11, 0, 0], seed)[0] % 100 < 9;
                    if hole { 2 } else { 8 }
                });
                let map = RankMap::from_ranks(geometry, &ranks.collect::<Vec<u8>>()).unwrap();
                // A swathe that is no rectangle, so that draws may fall outside it.
                let inside = geometry.cells().map(|cell| cell.row + cell.column < 24);
                let inside = Layer::new(geometry, inside.collect(), "swathe").unwrap();
                let nest = NestParams {
                    vicinity,
                    contact,
                    ..NestParams::default()
                };
                let params = SwarmParams {
                    agents: 9,
                    pellet_max,
                    explore,
                    seed,
                    nest,
                    ..SwarmParams::default()
                };
                let mut colony = Colony::deploy(&map, &inside, params).unwrap();
                colony.run(100_000, &mut silent());
                let nests = colony.take_nests().unwrap();
                colony.give_nests(&nests);
                colony.widen(&Layer::filled(geometry, true)).unwrap();
                colony.run(100_000, &mut silent());
                for turn in &colony.trace.turns {
                    let chart = if turn[0] == State::Build {
                        Chart::Nest
                    } else {
                        Chart::Swarm
                    };
                    made.extend(turn.windows(2).map(|pair| (chart, pair[0], pair[1])));
                }
            }
        }
        made
    }

    #[test]
    fn the_colony_makes_every_transition_of_the_table_and_no_other() {
        let table: HashSet<_> = TRANSITIONS.iter().map(|row| (row.chart, row.from, row.to)).collect();
        assert_eq!(table.len(), TRANSITIONS.len(), "a row stands twice");
        let made = made();
        assert_eq!(
            made.difference(&table).collect::<Vec<_>>(),
            Vec::<&(Chart, State, State)>::new()
        );
        assert_eq!(
            table.difference(&made).collect::<Vec<_>>(),
            Vec::<&(Chart, State, State)>::new()
        );
    }

    #[test]
    fn every_state_but_the_last_is_left_and_every_one_is_entered() {
        for state in State::ALL {
            assert_eq!(
                state != State::Done,
                TRANSITIONS.iter().any(|row| row.from == state),
                "{state:?}"
            );
            assert!(TRANSITIONS.iter().any(|row| row.to == state), "{state:?}");
            // An answer leads out of every question, and the answers differ.
            let whens: Vec<_> = TRANSITIONS
                .iter()
                .filter(|row| row.from == state)
                .map(|row| (row.chart, row.when))
                .collect();
            assert!((1..whens.len()).all(|i| !whens[..i].contains(&whens[i])), "{state:?}");
            assert!(!state.text().ends_with('?') || whens.len() > 1, "{state:?}");
        }
    }
}
