//! A small graph over text files: two scans, their labels, and a sum.

use mammotwin_data::{
    Failure,
    progress::{Progress, Silent},
    store::{
        Artifact, Drive, Entry, Listener, Options, Pass, Run, Stage, Store, Stored, execute, plan,
    },
};
use serde::Serialize;
use std::{
    collections::BTreeMap,
    fs,
    io::Write,
    path::{Path, PathBuf},
};

#[derive(Debug, Clone, PartialEq)]
pub struct Text(pub String);

impl Artifact for Text {
    const EXTENSION: &'static str = "txt";
    /// Letter by letter and slowly if `TOY_SLOW` is set, so that it can be interrupted; the disk
    /// is full at a `!`.
    fn save(&self, path: &Path) -> Result<(), Failure> {
        let slow = std::env::var_os("TOY_SLOW").is_some();
        let mut file = fs::File::create(path).map_err(|cause| Failure::io(path, cause))?;
        for letter in self.0.bytes() {
            if letter == b'!' {
                return Err(Failure::io(path, "no space left on device"));
            }
            if slow {
                std::thread::sleep(std::time::Duration::from_millis(2));
            }
            file.write_all(&[letter]).map_err(|cause| Failure::io(path, cause))?;
        }
        file.sync_all().map_err(|cause| Failure::io(path, cause))
    }
    fn load(path: &Path) -> Result<Self, Failure> {
        fs::read_to_string(path).map(Self).map_err(|cause| Failure::io(path, cause))
    }
}

/// Letters above a threshold.
#[derive(Serialize)]
pub struct Segment {
    pub threshold: char,
}

impl Stage for Segment {
    const NAME: &'static str = "segment";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "Letters were thresholded.";
    type Input = Text;
    type Output = Text;
    fn run(&self, scan: &Text, progress: &dyn Progress) -> Result<Text, Failure> {
        progress.report(0.5, "thresholding");
        progress.note("letters", scan.0.len() as f64);
        if scan.0.contains('z') {
            progress.warn("a z");
        }
        Ok(Text(scan.0.chars().filter(|c| *c >= self.threshold).collect()))
    }
}

/// All labels, one after the other.
#[derive(Serialize)]
pub struct Join {
    pub separator: &'static str,
}

impl Stage for Join {
    const NAME: &'static str = "join";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "Labels were joined.";
    type Input = (Vec<Text>, Option<Text>);
    type Output = Text;
    fn run(&self, (labels, _): &Self::Input, _: &dyn Progress) -> Result<Text, Failure> {
        let labels: Vec<_> = labels.iter().map(|label| label.0.as_str()).collect();
        Ok(Text(labels.join(self.separator)))
    }
}

/// Length of the text; refuses a given one.
#[derive(Serialize)]
pub struct Measure {
    pub refuse: usize,
}

impl Stage for Measure {
    const NAME: &'static str = "measure";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "Lengths were measured.";
    type Input = Text;
    type Output = Text;
    fn run(&self, text: &Text, _: &dyn Progress) -> Result<Text, Failure> {
        if text.0.len() == self.refuse {
            return Err(Failure::Numerics("an unlucky length".into()));
        }
        Ok(Text(text.0.len().to_string()))
    }
}

/// What a person may change.
#[derive(Clone)]
pub struct Plan {
    pub threshold: char,
    pub separator: &'static str,
    pub refuse: usize,
}

impl Default for Plan {
    fn default() -> Self {
        Self { threshold: 'b', separator: "+", refuse: 1000 }
    }
}

pub fn graph(plan: &Plan, run: &Run<'_>) -> Result<Stored<Text>, Failure> {
    let mut labels = Vec::new();
    for pose in ["prone", "supine"] {
        let scan =
            run.external(&format!("poses.{pose}.image"), Path::new(&format!("{pose}.txt")))?;
        let segment = Segment { threshold: plan.threshold };
        labels.push(run.editable(&format!("labels/{pose}"), pose, &segment, &scan)?);
    }
    let joined = run.stage("", &Join { separator: plan.separator }, (&labels, None))?;
    run.export("joined.txt", &joined)?;
    run.stage("", &Measure { refuse: plan.refuse }, &joined)
}

/// A study folder with its scans.
pub struct Study {
    pub folder: tempfile::TempDir,
    pub plan: Plan,
    pub options: Options,
}

impl Study {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("prone.txt"), "abcabc").unwrap();
        fs::write(folder.path().join("supine.txt"), "aabbcc").unwrap();
        Self { folder, plan: Plan::default(), options: Options::default() }
    }

    pub fn store(&self) -> Store {
        Store::open(&self.folder.path().join("out"))
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn run_with(&self, listener: &dyn Listener) -> Result<Pass<Stored<Text>>, Failure> {
        let (store, base) = (self.store(), self.folder.path());
        let drive = Drive { store: &store, base, options: &self.options, listener };
        execute(&drive, |run| graph(&self.plan, run))
    }

    pub fn run(&self) -> Pass<Stored<Text>> {
        self.run_with(&Silent).unwrap()
    }

    /// Content of all results, by place below the cache.
    pub fn results(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut found = BTreeMap::new();
        for path in self.files() {
            let name = path.file_name().unwrap().to_str().unwrap();
            if name.starts_with("result.") || name == "key.json" {
                let place = path.strip_prefix(self.folder.path()).unwrap();
                found.insert(place.to_owned(), fs::read(&path).unwrap());
            }
        }
        found
    }

    /// All files of results, sorted.
    pub fn files(&self) -> Vec<PathBuf> {
        fn visit(folder: &Path, found: &mut Vec<PathBuf>) {
            for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
                match entry.path() {
                    path if path.is_dir() => visit(&path, found),
                    path => found.push(path),
                }
            }
        }
        let mut found = Vec::new();
        visit(&self.folder.path().join("out/cache"), &mut found);
        found.retain(|path| path.file_name().unwrap() != "hashes.json");
        found.sort();
        found
    }

    pub fn plan(&self) -> Pass<Stored<Text>> {
        let (store, base) = (self.store(), self.folder.path());
        let drive = Drive { store: &store, base, options: &self.options, listener: &Silent };
        plan(&drive, |run| graph(&self.plan, run)).unwrap()
    }
}

/// Instances that a pass computed.
pub fn computed<R>(pass: &Pass<R>) -> Vec<&str> {
    let computed = pass.entries.iter().filter(|entry| entry.computed);
    computed.map(|entry| entry.instance.as_str()).collect()
}

pub fn entry<'a, R>(pass: &'a Pass<R>, instance: &str) -> &'a Entry {
    pass.entries.iter().find(|entry| entry.instance == instance).unwrap()
}
