//! Attachments of a recording that are lost. Those of one name count by their order, so that those behind a lost one are not known.

/// Attachments that are lost.
#[derive(Debug, Default)]
pub(super) struct LostAttachments {
    names: Vec<String>,
    /// True where one is lost whose name is not known.
    unnamed: bool,
    /// True where it was told that those behind it are left out.
    told: bool,
}

impl LostAttachments {
    /// Tells whether one of this name may be lost.
    pub(super) fn has(&self, name: &str) -> bool {
        self.unnamed || self.names.iter().any(|lost| lost == name)
    }

    /// Tells, once, that attachments are left out for one whose name is not known.
    pub(super) fn is_first_untold(&mut self) -> bool {
        self.unnamed && !std::mem::replace(&mut self.told, self.unnamed)
    }

    /// Adds one; `None` stands for a name that is not known.
    pub(super) fn add(&mut self, name: Option<&str>) {
        match name {
            Some(name) => self.names.push(name.to_owned()),
            None => self.unnamed = true,
        }
    }
}
