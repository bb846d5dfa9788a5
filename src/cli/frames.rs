//! Which frames, and the files that they go to.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::Failure;
use crate::scene::TimeBase;
use crate::scene::limit::{ANY, LARGEST_FRAME};

/// What to write instead of ranges that cannot be read.
const EXPECTED: &str = "expected frames such as 1-240, 1-240x2, 1,5,9-12 or all";

/// Frames as the command line names them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Frames {
    /// All of the scene's own.
    All,
    /// In the order given, none of them twice.
    These(Vec<i64>),
}

impl FromStr for Frames {
    type Err = String;

    /// `a`, `a-b` or `a-bxs`, comma separated, or `all`.
    fn from_str(text: &str) -> Result<Frames, String> {
        if text.trim() == "all" {
            return Ok(Frames::All);
        }
        let (mut frames, mut seen) = (Vec::new(), BTreeSet::new());
        for range in text.split(',') {
            let Range { first, last, step } = range.trim().parse()?;
            let step = usize::try_from(step).map_err(|_| EXPECTED)?;
            frames.extend((first..=last).step_by(step).filter(|frame| seen.insert(*frame)));
        }
        Ok(Frames::These(frames))
    }
}

/// From the first to the last, each `step` after the one before.
struct Range {
    first: i64,
    last: i64,
    step: i64,
}

impl FromStr for Range {
    type Err = String;

    fn from_str(text: &str) -> Result<Range, String> {
        let number = |digits: &str| {
            let plain = !digits.is_empty() && !digits.starts_with('+');
            digits.parse::<i64>().ok().filter(|_| plain).ok_or_else(|| EXPECTED.to_owned())
        };
        let (range, step) = text.split_once('x').unwrap_or((text, "1"));
        // A minus that does not begin a number divides two.
        let dash = range.char_indices().skip(1).find(|(_, c)| *c == '-').map(|(at, _)| at);
        let (first, last) = match dash {
            Some(at) => (number(&range[..at])?, number(&range[at + 1..])?),
            None if range.len() < text.len() => return Err(EXPECTED.to_owned()),
            None => (number(range)?, number(range)?),
        };
        let step = number(step)?;
        if last < first {
            return Err(format!("{text} ends before it begins"));
        }
        if step < 1 {
            return Err(format!("the step of {text} is below 1"));
        }
        if first < -LARGEST_FRAME || last > LARGEST_FRAME {
            return Err(format!("{text} goes beyond frames -{LARGEST_FRAME} to {LARGEST_FRAME}"));
        }
        Ok(Range { first, last, step })
    }
}

impl Frames {
    /// The frames of a scene with this time.
    pub(super) fn of(&self, time: TimeBase) -> Result<Vec<i64>, Failure> {
        let frames = match (self, time.end) {
            (Frames::These(frames), _) => frames.clone(),
            (Frames::All, Some(end)) => (time.start..=end).collect(),
            (Frames::All, None) => {
                let failure = Failure::usage("--frames all: the scene does not say which frame is its last");
                return Err(failure.hint("give it one, such as `end = 240` in [time], or name the frames"));
            }
        };
        match frames.iter().find(|frame| !ANY.admits(time.seconds(**frame))) {
            None => Ok(frames),
            Some(frame) => Err(Failure::usage(format!(
                "frame {frame} is {:e} seconds after the scene's start, and at most 1e9 are possible",
                time.seconds(*frame)
            ))),
        }
    }
}

/// Frames as `--frames` takes them: ranges where three or more are evenly spaced.
pub(super) fn ranges(mut frames: &[i64]) -> String {
    let mut out = Vec::new();
    while let Some((&first, rest)) = frames.split_first() {
        let step = rest.first().map_or(0, |second| second - first);
        let even = frames.windows(2).take_while(|pair| step > 0 && pair[1] - pair[0] == step).count();
        let count = if even < 2 { 1 } else { even + 1 };
        out.push(match (frames[count - 1], step) {
            (last, _) if last == first => first.to_string(),
            (last, 1) => format!("{first}-{last}"),
            (last, step) => format!("{first}-{last}x{step}"),
        });
        frames = &frames[count..];
    }
    out.join(",")
}

/// A path with a place for the frame's number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pattern {
    folder: PathBuf,
    before: String,
    digits: usize,
    after: String,
}

impl Pattern {
    /// Four digits between a scene's name and the extension.
    pub(super) fn of_scene(name: &str) -> Pattern {
        Pattern { folder: PathBuf::new(), before: format!("{name}."), digits: 4, after: ".vdb".to_owned() }
    }

    /// A path whose name holds one run of `#`, one for each digit.
    pub(super) fn new(path: &Path) -> Result<Pattern, Failure> {
        let fail = |what: &str| {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().replace('#', "");
            let stem = stem.trim_end_matches('.');
            let extension = path.extension().unwrap_or_default().to_string_lossy().replace('#', "");
            let example = path.with_file_name(format!("{stem}.####.{extension}"));
            Err(Failure::usage(format!("the output {} has {what} for the number", path.display())).hint(
                format!("one run of #, one for each digit, in the file's name: -o {}", example.display()),
            ))
        };
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            return fail("no place");
        };
        let Some(start) = name.find('#') else { return fail("no place") };
        let digits = name[start..].bytes().take_while(|byte| *byte == b'#').count();
        let (before, after) = (name[..start].to_owned(), name[start + digits..].to_owned());
        if after.contains('#') {
            return fail("more than one place");
        }
        let folder = path.parent().map(Path::to_owned).unwrap_or_default();
        Ok(Pattern { folder, before, digits, after })
    }

    /// The path of a frame: its number with zeros in front, the sign before those.
    pub(super) fn path(&self, frame: i64) -> PathBuf {
        let sign = if frame < 0 { "-" } else { "" };
        let number = frame.unsigned_abs();
        self.folder.join(format!("{}{sign}{number:0width$}{}", self.before, self.after, width = self.digits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn these(text: &str) -> Vec<i64> {
        match text.parse().unwrap_or_else(|error| panic!("{text}: {error}")) {
            Frames::These(frames) => frames,
            Frames::All => panic!("{text} is not all"),
        }
    }

    #[test]
    fn frames_are_read_in_the_order_given_and_none_twice() {
        for (text, expected) in [
            ("7", &[7][..]),
            ("1-4", &[1, 2, 3, 4]),
            ("1-8x3", &[1, 4, 7]),
            ("5-5", &[5]),
            ("9,1-3,2-4", &[9, 1, 2, 3, 4]),
            ("-2", &[-2]),
            ("-2-1", &[-2, -1, 0, 1]),
            ("-5--3", &[-5, -4, -3]),
            ("-5--1x2, 7", &[-5, -3, -1, 7]),
        ] {
            assert_eq!(these(text), expected, "{text}");
        }
        assert_eq!("all".parse(), Ok(Frames::All));
        for text in
            ["", "a", "1-", "-", "1,,2", "3-1", "1-5x0", "1-5x-1", "1x2", "1.5", "1-2-3", "+1", "1-2000000"]
        {
            assert!(text.parse::<Frames>().is_err(), "{text}");
        }
    }

    #[test]
    fn ranges_are_read_as_what_they_were_made_from() {
        for (frames, expected) in [
            (&[7][..], "7"),
            (&[1, 2, 3], "1-3"),
            (&[1, 2], "1,2"),
            (&[-5, -3, -1, 7, 8], "-5--1x2,7,8"),
            (&[9, 1, 2, 3, 10, 5], "9,1-3,10,5"),
            (&[3, 2, 1], "3,2,1"),
        ] {
            assert_eq!(ranges(frames), expected);
            assert_eq!(these(expected), frames);
        }
    }

    #[test]
    fn a_pattern_takes_one_number_into_the_files_name() {
        let path = |pattern: &str, frame| {
            Pattern::new(Path::new(pattern)).expect("a pattern").path(frame).display().to_string()
        };
        assert_eq!(path("a.####.vdb", 7), "a.0007.vdb");
        assert_eq!(path("a.####.vdb", -7), "a.-0007.vdb");
        assert_eq!(path("f#/a_#.vdb", 123), "f#/a_123.vdb");
        assert_eq!(path("/x/##.vdb", 0), "/x/00.vdb");
        assert_eq!(Pattern::of_scene("s").path(12).display().to_string(), "s.0012.vdb");
        for wrong in ["a.vdb", "#/a.vdb", "a#.##.vdb", ".."] {
            assert!(Pattern::new(Path::new(wrong)).is_err(), "{wrong}");
        }
        let mut message = vec![];
        let failure = Pattern::new(Path::new("out/a##b##.vdb")).expect_err("two places");
        failure.report(&mut message).expect("written");
        assert_eq!(
            String::from_utf8_lossy(&message),
            "error: the output out/a##b##.vdb has more than one place for the number\n\
             hint: one run of #, one for each digit, in the file's name: -o out/ab.####.vdb\n"
        );
    }

    #[test]
    fn frames_lie_within_the_scenes_time() {
        let time = TimeBase { fps: 1e-6, start: 1, end: Some(3) };
        assert_eq!(Frames::All.of(time).expect("all"), [1, 2, 3]);
        assert_eq!(Frames::These(vec![2000]).of(time).expect_err("too late").exit_code(), 2);
        assert_eq!(Frames::All.of(TimeBase { end: None, ..time }).expect_err("no end").exit_code(), 2);
    }
}
