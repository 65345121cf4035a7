//! What keeps a database from being used, in the words of its operator.

use std::error::Error;
use std::fmt;
use std::sync::Arc;

/// A known cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// Another program has locked the file.
    Locked,
    /// The file may only be read.
    ReadOnly,
    /// The system refuses a read or a write.
    Refused,
    /// The file is no database, or not a whole one.
    Damaged,
    /// There is no room.
    Full,
    /// The file cannot be opened.
    Closed,
    /// The file is not the one that was opened.
    Gone,
}

impl Trouble {
    /// What is the matter.
    pub(crate) fn what(self) -> &'static str {
        match self {
            Self::Locked => "another program has locked the database",
            Self::ReadOnly => "the database may only be read",
            Self::Refused => "the system refuses to read or write the database",
            Self::Damaged => "the database is damaged",
            Self::Full => "the disk is full",
            Self::Closed => "a file of the database cannot be opened",
            Self::Gone => "the database was removed, replaced or cut short while in use",
        }
    }

    /// What to do about it.
    pub(crate) fn advice(self) -> &'static str {
        match self {
            Self::Locked => "end the program that has the file open (`fuser` names it), then try again",
            Self::ReadOnly | Self::Closed => {
                "run as the user to whom the folder belongs, make the folder and its files writable, or name another \
                 one with --data DIR"
            }
            Self::Refused => {
                "the system's log tells of faults of the disk; a limit of file sizes (`ulimit -f`) refuses writes, too"
            }
            Self::Damaged => "`manduca db check` says what is damaged; docs/operations.md says how to restore a copy",
            Self::Full => "make room on the disk",
            Self::Gone => "stop the coordinator, put the database back and start again",
        }
    }

    /// The cause among an error and the errors below it.
    pub(crate) fn of(error: &(dyn Error + 'static)) -> Option<Self> {
        let mut below = Some(error);
        while let Some(error) = below {
            let sql = error.downcast_ref::<sqlx::Error>();
            let sql = sql.or_else(|| error.downcast_ref::<Arc<sqlx::Error>>().map(AsRef::as_ref));
            if let Some(found) = sql.and_then(Self::of_sql) {
                return Some(found);
            }
            below = error.source();
        }
        None
    }

    fn of_sql(error: &sqlx::Error) -> Option<Self> {
        match error {
            sqlx::Error::Io(error) if error.get_ref().is_some_and(|inner| inner.is::<Gone>()) => Some(Self::Gone),
            sqlx::Error::Database(error) => Self::of_code(error.code()?.parse().ok()?),
            _ => None,
        }
    }

    /// By SQLite's result code, whose last byte is the primary one.
    fn of_code(code: i32) -> Option<Self> {
        Some(match code & 0xff {
            5 | 6 => Self::Locked,
            3 | 8 => Self::ReadOnly,
            10 => Self::Refused,
            11 | 26 => Self::Damaged,
            13 => Self::Full,
            14 => Self::Closed,
            _ => return None,
        })
    }
}

/// The files of a database are not those that were opened.
#[derive(Debug)]
pub(crate) struct Gone;

impl fmt::Display for Gone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(Trouble::Gone.what())
    }
}

impl Error for Gone {}

/// [`Gone`] as an error of the database.
pub(super) fn gone() -> sqlx::Error {
    sqlx::Error::Io(std::io::Error::other(Gone))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::StoreError;

    #[test]
    fn a_cause_is_found_however_deep() {
        assert_eq!(Trouble::of(&StoreError::Commit(Arc::new(gone()))), Some(Trouble::Gone));
        assert_eq!(Trouble::of(&StoreError::Sql(gone())), Some(Trouble::Gone));
        assert_eq!(Trouble::of(&StoreError::Sql(sqlx::Error::RowNotFound)), None);
        assert_eq!(
            [5, 261, 778, 26, 13, 14, 1].map(Trouble::of_code),
            [
                Some(Trouble::Locked),
                Some(Trouble::Locked),
                Some(Trouble::Refused),
                Some(Trouble::Damaged),
                Some(Trouble::Full),
                Some(Trouble::Closed),
                None
            ]
        );
    }
}
