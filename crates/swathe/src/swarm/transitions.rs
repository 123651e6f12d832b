//! What an agent does and in which order: one table, from which the flow charts are drawn and against which the colony
//! is tested. The states are those of the two flow charts of Vckay, Aneja and Deodhare; what they leave open is ours.

/// A state of an agent, or of the nest that it builds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum State {
    /// Put on a random cell of the swathe.
    Deploy,
    /// Moving on from the cell of the last tick.
    Forage,
    /// Asking for the rank of the cell that it stands on.
    Look,
    /// Counting the pellets of a suitable cell.
    Count,
    /// Adding a pellet.
    Drop,
    /// The cell is a focus: nest building begins.
    Build,
    /// No cell can become a core any more.
    Done,
    /// Asking for the rank of a cell of the focus's vicinity.
    Examine,
    /// The focus will never be a core.
    Reject,
    /// The focus is a core.
    Core,
    /// A cell of the vicinity becomes part of the nest.
    Join,
    /// Two nests in contact become one.
    Merge,
}

impl State {
    /// Every state in the order of the charts.
    pub const ALL: [Self; 12] = [
        Self::Deploy,
        Self::Forage,
        Self::Look,
        Self::Count,
        Self::Drop,
        Self::Build,
        Self::Done,
        Self::Examine,
        Self::Reject,
        Self::Core,
        Self::Join,
        Self::Merge,
    ];

    /// A stable word for files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Deploy => "deploy",
            Self::Forage => "forage",
            Self::Look => "look",
            Self::Count => "count",
            Self::Drop => "drop",
            Self::Build => "build",
            Self::Done => "done",
            Self::Examine => "examine",
            Self::Reject => "reject",
            Self::Core => "core",
            Self::Join => "join",
            Self::Merge => "merge",
        }
    }

    /// What stands in its box of a flow chart; a question where the way divides by an answer.
    pub fn text(self) -> &'static str {
        match self {
            Self::Deploy => "Put an agent on a random cell of the swathe",
            Self::Forage => "Forage: move to a neighbouring cell",
            Self::Look => "Is the cell suitable?",
            Self::Count => "Is there room for a pellet?",
            Self::Drop => "Drop a pellet: is the cell full?",
            Self::Build => "The cell is a focus: build a nest",
            Self::Done => "The swarm is finished",
            Self::Examine => "Is this cell of the vicinity suitable?",
            Self::Reject => "Reject the focus for good",
            Self::Core => "The focus is a core: its vicinity is a nest",
            Self::Join => "Join a cell of the vicinity: does it touch another nest?",
            Self::Merge => "Merge the two nests",
        }
    }
}

/// Which flow chart a transition belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Chart {
    /// What an agent does.
    Swarm,
    /// What happens at a focus.
    Nest,
}

impl Chart {
    /// A stable word for files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Swarm => "swarm",
            Self::Nest => "nest",
        }
    }
}

/// A step from one state to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transition {
    /// Its flow chart.
    pub chart: Chart,
    /// The state left.
    pub from: State,
    /// The state entered.
    pub to: State,
    /// When it is taken.
    pub when: &'static str,
}

const fn swarm(from: State, to: State, when: &'static str) -> Transition {
    let chart = Chart::Swarm;
    Transition { chart, from, to, when }
}

const fn nest(from: State, to: State, when: &'static str) -> Transition {
    let chart = Chart::Nest;
    Transition { chart, from, to, when }
}

/// Every transition there is. No other is ever made, and each is made by some swarm.
pub const TRANSITIONS: [Transition; 26] = [
    swarm(State::Deploy, State::Look, "arrived"),
    swarm(State::Forage, State::Look, "moved"),
    swarm(State::Forage, State::Deploy, "now and then"),
    swarm(State::Forage, State::Forage, "drawn outside the swathe"),
    swarm(State::Look, State::Forage, "no"),
    swarm(State::Look, State::Count, "yes"),
    swarm(State::Count, State::Forage, "no"),
    swarm(State::Count, State::Drop, "yes"),
    swarm(State::Drop, State::Forage, "no"),
    swarm(State::Drop, State::Build, "yes"),
    swarm(State::Build, State::Forage, "built or rejected"),
    swarm(State::Forage, State::Done, "no cell can become a core any more"),
    nest(State::Build, State::Examine, "the first cell"),
    nest(State::Build, State::Reject, "a cell is known to be unsuitable"),
    nest(State::Build, State::Forage, "it was a core already"),
    nest(State::Examine, State::Examine, "yes, the next cell"),
    nest(State::Examine, State::Reject, "no"),
    nest(State::Examine, State::Core, "all are"),
    nest(State::Reject, State::Forage, "back to foraging"),
    nest(State::Core, State::Join, "the first cell"),
    nest(State::Join, State::Join, "no, the next cell"),
    nest(State::Join, State::Merge, "yes"),
    nest(State::Join, State::Forage, "all are joined"),
    nest(State::Merge, State::Join, "the next cell"),
    nest(State::Merge, State::Merge, "it touches one more"),
    nest(State::Merge, State::Forage, "all are joined"),
];
