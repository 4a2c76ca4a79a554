//! sweep
use hidden_rig::{build_sheet::*, effects::*, excitation::*, rng::Draws, run::*, sizing::*};
fn main() {
    let only = std::env::args().nth(1);
    let sheet = BuildSheet::draw(&mut Draws::new(11), Spread::MOVED);
    let t0 = std::time::Instant::now();
    let range = commission(&sheet.rig());
    println!("{range:?} {:.2} s", t0.elapsed().as_secs_f64());
    let range = range.unwrap();
    let holds = random_holds(&mut Draws::new(3), &range, 1500);
    let probe = Probe::without_sensitivities(&sheet, &holds);
    for kind in Kind::ALL {
        if only.as_ref().is_some_and(|o| kind.name() != o) { continue; }
        let shape = kind.draw(&mut Draws::new(5));
        for place in kind.places() {
            let (lo, hi) = kind.strengths();
            let mut out = format!("{} {place:?}:", kind.name());
            for s in [lo, (lo * hi).sqrt(), hi] {
                let mut rig = probe.rig();
                shape.at_strength(s).install(*place, &mut rig);
                let t = std::time::Instant::now();
                let mut run = Run::settled(&rig, holds[0], Precision::Coarse);
                let mut tr = Vec::new();
                for d in &holds { tr.push(run.clean_kpa()); run.tick(*d, true); if t.elapsed().as_secs_f64() > 5.0 { out += " STUCK"; break; } }
                let r = rms(&difference(&tr, probe.nominal()));
                out += &format!("  {s:.2e}: {:.3} {:.3} ({:.2} s {})", r[0], r[1], t.elapsed().as_secs_f64(), run.effort().steps);
            }
            println!("{out}");
        }
    }
}
