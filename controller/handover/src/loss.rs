//! Reason why a candidate loses its authority, as events carry it and as operators read it.

/// Reason why a candidate loses its authority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Loss {
    /// It answered something that is not finite.
    NotFinite = 1,
    /// The candidate's errors are worse than the incumbent's in like conditions.
    Worse = 2,
    /// It was not found as good within three minutes on a level.
    Undecided = 3,
    /// The safety filter had to bend commands that it had a part in.
    Filtered = 4,
    /// The candidate's duties hunt.
    Hunts = 5,
    /// The pressures went far off.
    FarOff = 6,
    /// An operator took it back.
    Withdrawn = 7,
    /// The rig was vented while it was in full authority.
    Vented = 8,
}

impl Loss {
    /// The loss of a number.
    pub fn of_code(code: u8) -> Option<Self> {
        [
            Loss::NotFinite,
            Loss::Worse,
            Loss::Undecided,
            Loss::Filtered,
            Loss::Hunts,
            Loss::FarOff,
            Loss::Withdrawn,
            Loss::Vented,
        ]
        .into_iter()
        .find(|loss| *loss as u8 == code)
    }

    /// One line for an operator, without the stage.
    pub fn reason(self) -> &'static str {
        match self {
            Loss::NotFinite => "answers something that is not finite",
            Loss::Worse => "its errors are worse than those of what it was to replace, in like conditions",
            Loss::Undecided => "not found as good as what it was to replace within three minutes on one level",
            Loss::Filtered => "the safety filter had to bend its commands",
            Loss::Hunts => "its duties hunt",
            Loss::FarOff => "the pressures went far from the reference",
            Loss::Withdrawn => "taken back by an operator",
            Loss::Vented => "the rig was vented while it had authority",
        }
    }
}
