//! A disk and a clock under a test's control: a library preloaded into a
//! coordinator, built from `tests/shim/disk.c` by the system's C compiler.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::program::repository;

/// The built library.
fn library() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let folder = std::env::temp_dir().join(format!("manduca-shim-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder can be made");
        let library = folder.join("disk.so");
        let built = Command::new("cc")
            .args(["-O2", "-shared", "-fPIC", "-o"])
            .arg(&library)
            .arg(repository().join("tests/shim/disk.c"))
            .args(["-ldl", "-lpthread"])
            .status();
        assert!(built.is_ok_and(|status| status.success()), "these tests need a C compiler (`cc`)");
        library
    })
}

/// One record of the journal.
#[derive(Debug)]
struct Record {
    kind: u8,
    path: PathBuf,
    offset: usize,
    data: Vec<u8>,
}

/// A watched folder.
#[derive(Debug, Clone)]
pub struct Shim {
    folder: PathBuf,
    control: PathBuf,
    journal: PathBuf,
}

impl Shim {
    /// Watches `folder`; its own files go to `beside`.
    pub fn new(folder: &Path, beside: &Path) -> Self {
        let shim = Self {
            folder: folder.to_owned(),
            control: beside.join("shim-control"),
            journal: beside.join("shim-journal"),
        };
        shim.set("");
        shim
    }

    /// What a process under it is started with; with a journal where power is to be cut.
    pub fn environment(&self, journal: bool) -> Vec<(String, String)> {
        let text = |path: &Path| path.to_str().expect("a temporary folder has a plain name").to_owned();
        let mut all = vec![
            ("LD_PRELOAD".to_owned(), text(library())),
            ("MANDUCA_SHIM_FOLDER".to_owned(), text(&self.folder)),
            ("MANDUCA_SHIM_CONTROL".to_owned(), text(&self.control)),
        ];
        if journal {
            all.push(("MANDUCA_SHIM_JOURNAL".to_owned(), text(&self.journal)));
        }
        all
    }

    /// Orders to the shim: `full`, `sync`, `clock N`, or none.
    pub fn set(&self, orders: &str) {
        let new = self.control.with_extension("new");
        fs::write(&new, orders).expect("is written");
        fs::rename(new, &self.control).expect("is renamed");
    }

    /// The watched files as they are now, from which a later cut begins.
    pub fn base(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let _ = fs::remove_file(&self.journal);
        let Ok(entries) = fs::read_dir(&self.folder) else { return BTreeMap::new() };
        let files = entries.flatten().map(|entry| entry.path()).filter(|path| !path.to_string_lossy().contains("-shm"));
        files.map(|path| (path.clone(), fs::read(&path).expect("is read"))).collect()
    }

    /// Leaves in the folder what a power cut may leave: all that was synced, and of the
    /// writes after that whatever `chance` lets through. With `lying` nothing counts as synced.
    pub fn cut_power(&self, mut durable: BTreeMap<PathBuf, Vec<u8>>, lying: bool, mut chance: impl FnMut() -> bool) {
        let mut pending: BTreeMap<PathBuf, Vec<Record>> = BTreeMap::new();
        for record in self.records() {
            match record.kind {
                b's' if lying => {}
                b's' => {
                    let settled = pending.remove(&record.path).unwrap_or_default();
                    settled.iter().for_each(|r| apply(r, durable.entry(record.path.clone()).or_default()));
                }
                b'u' => {
                    pending.remove(&record.path);
                    durable.remove(&record.path);
                }
                _ => pending.entry(record.path.clone()).or_default().push(record),
            }
        }
        for (path, records) in pending {
            for record in records.iter().filter(|_| chance()) {
                apply(record, durable.entry(path.clone()).or_default());
            }
        }
        for entry in fs::read_dir(&self.folder).expect("is read").flatten() {
            fs::remove_file(entry.path()).expect("is removed");
        }
        for (path, bytes) in durable {
            fs::write(path, bytes).expect("is written");
        }
    }

    fn records(&self) -> Vec<Record> {
        let bytes = fs::read(&self.journal).unwrap_or_default();
        let (mut rest, mut records) = (bytes.as_slice(), Vec::new());
        while rest.len() >= 25 {
            let number = |i: usize| {
                let bytes = rest[1 + 8 * i..9 + 8 * i].try_into().expect("eight bytes");
                usize::try_from(i64::from_ne_bytes(bytes)).expect("no negative length")
            };
            let (named, offset, length) = (number(0), number(1), number(2));
            let kind = rest[0];
            if rest.len() < 25 + named + length {
                break;
            }
            let path = PathBuf::from(String::from_utf8_lossy(&rest[25..25 + named]).into_owned());
            records.push(Record { kind, path, offset, data: rest[25 + named..25 + named + length].to_vec() });
            rest = &rest[25 + named + length..];
        }
        records
    }
}

fn apply(record: &Record, file: &mut Vec<u8>) {
    if record.kind == b't' {
        return file.resize(record.offset, 0);
    }
    let end = record.offset + record.data.len();
    if file.len() < end {
        file.resize(end, 0);
    }
    file[record.offset..end].copy_from_slice(&record.data);
}
