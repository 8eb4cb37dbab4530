//! One process computes a result; others wait. A lock dies with its process.

use crate::Failure;
use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io::{Read, Seek, Write},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

/// What to do when another process holds the lock.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Wait {
    /// Wait until it is done.
    #[default]
    Patient,
    /// Give up with [`Failure::Busy`].
    Refuse,
}

/// A lock that is held; dropping it releases it and removes its file.
#[derive(Debug)]
pub(super) struct Lock {
    file: File,
    path: PathBuf,
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Unlinked while held: whoever waits on this file sees that it is gone and opens anew.
        let _ = fs::remove_file(&self.path);
        let _ = self.file.unlock();
    }
}

/// Takes the lock at `path`. When somebody else holds it, `busy` is told who.
pub(super) fn acquire(path: &Path, wait: Wait, busy: &dyn Fn(&str)) -> Result<Lock, Failure> {
    let failed = |cause: std::io::Error| Failure::io(path, cause);
    loop {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::Error(cause)) => return Err(failed(cause)),
            Err(TryLockError::WouldBlock) => {
                let holder = read_holder(&mut file);
                if wait == Wait::Refuse {
                    return Err(Failure::Busy(format!("{}: held by {holder}", path.display())));
                }
                busy(&holder);
                file.lock().map_err(failed)?;
            }
        }
        let same = |there: fs::Metadata| file.metadata().is_ok_and(|m| m.ino() == there.ino());
        if !fs::metadata(path).is_ok_and(same) {
            continue;
        }
        file.set_len(0).and_then(|()| file.rewind()).map_err(failed)?;
        file.write_all(holder_text().as_bytes()).map_err(failed)?;
        return Ok(Lock { file, path: path.to_owned() });
    }
}

/// Who holds the lock now; `None` when nobody does.
pub(super) fn holder(path: &Path) -> Option<String> {
    let mut file = File::open(path).ok()?;
    match file.try_lock_shared() {
        Err(TryLockError::WouldBlock) => Some(read_holder(&mut file)),
        _ => None,
    }
}

/// How often, and after how long, the name of a holder that has just locked is looked for.
const LOOKS: usize = 50;
const BETWEEN_LOOKS: Duration = Duration::from_millis(1);

/// Who holds a locked file. The holder writes its name right after it has locked, not with it.
fn read_holder(file: &mut File) -> String {
    for _ in 0..LOOKS {
        let mut text = String::new();
        let _ = file.rewind().and_then(|()| file.read_to_string(&mut text));
        if text.ends_with('\n') {
            return text.trim().into();
        }
        thread::sleep(BETWEEN_LOOKS);
    }
    "another process".into()
}

/// `process 4711 on lab3 (mammotwin run)`: the command without its arguments, which may be private.
fn holder_text() -> String {
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let mut words = std::env::args_os();
    let program = words.next().unwrap_or_default();
    let program = Path::new(&program).file_name().unwrap_or_default().to_string_lossy();
    let command = words.next().filter(|word| !word.to_string_lossy().starts_with('-'));
    let command = command.unwrap_or_default();
    let command = format!("{program} {}", command.to_string_lossy());
    format!("process {} on {} ({})\n", std::process::id(), host.trim(), command.trim())
}
