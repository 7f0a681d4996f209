// Renderers under a hand, and blinded studies of them.
#include "experiments/live/live.h"
#include "experiments/bridge/serve.h"
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/live/recording_session.h"
#include "experiments/psychophysics/blinded.h"

namespace palpate::experiments {
namespace {

void declare_live(const Declaration& declare, LiveArguments& a) {
  constexpr NumberRange kSeconds{0.1, 86'400.0}, kEvery{0.0, 86'400.0}, kFade{1.0, 1'000.0},
      kStandIn{0.0, 1e7};
  RunArguments& run = a.run;
  declare_scene_or_stream(declare, run);
  declare_renderers(declare, run.renderers,
                    "the scene's or planned one, cloud, and a mesh; at most 7, the first is felt first");
  declare_device(declare, a.device);
  declare.text("--hand", a.hand,
               "what the simulated hand does: explore by what it feels, follow the path, press, slide, tap, "
               "or mouse: go where the mouse does (default: explore; follow with a --path other than hand; "
               "mouse with --window)");
  declare.number("--seconds", a.seconds, kSeconds,
                 "length of the session (default: 10; with --window until it is closed)");
  declare.number("--switch-every", a.switch_every_s, kEvery,
                 "seconds between switches to the next renderer (default: 0, never)");
  declare.rare().text("--rule", a.rule,
                      "for a switch asked for in contact: wait (fade, else wait for free space), refuse "
                      "(fade, else refuse) or free (wait for free space) (default: wait)");
  declare.rare().number("--fade", a.fade_ms, kFade,
                        "length of a fade in contact, ms; 100 to 200 is sensible (default: 150)");
  declare.rare().text("--changes", a.changes,
                      "SECONDS:LABEL:key=value[:key=value..],..: changes a renderer's options while it is "
                      "felt, also stiffness (N/mm) and force_limit (N)");
  declare.rare().text(
      "--mapping", a.mapping,
      "of the workspace: 1:1, fitted, or mm of the scene per mm of the device (default: 1:1)");
  declare_rate(declare.rare(), a.rate_hz);
  declare.flag("--accelerated", a.accelerated,
               "on a virtual clock, as fast as possible: the same session every time");
  declare.flag("--window", a.window,
               "show a window: the cloud, what is felt, plots, buttons to switch; without a device the mouse "
               "is the hand. Drop a scan on it to open it");
  declare.rare().text("--up", a.up,
                      "axis that is up in the window: z, y (most scans of objects), x, -z, -y or -x; key u "
                      "takes the next (default: the scene's [view], else z)");
  declare.rare().number(
      "--stand-in", a.stand_in, kStandIn,
      "points of the coarse cloud that is felt in a window until the renderers of a larger scene are "
      "prepared; 0: none (default: 60000)");
  declare.text("--listen", a.listen,
               "PORT or ADDRESS:PORT: take commands over UDP, as OSC or lines of JSON: switch, select, "
               "cancel, mark, re-arm; port 0: any free one");
  declare.rare().flag("--rearm", a.rearm, "arm again a second after a fault (only simulated devices)");
  declare.text("--record", a.record, "FILE.palrec: record the session, with every renderer");
  declare_path(declare, run.path, "fitted to the model");
  declare_force(declare, a.replace);
  declare_scene_run(declare, run);
}

void declare_record(const Declaration& declare, RecordArguments& a) {
  constexpr NumberRange kSeconds{0.0, 86'400.0, true};
  declare.required("SCENE", a.scene, kSceneHelp);
  declare_renderer(declare, a.renderer);
  declare_device(declare, a.device);
  declare_path(declare, a.path, "fitted to the model, as long as the session");
  declare.number("--seconds", a.seconds, kSeconds, "length of the session (default: 10)");
  declare_rate(declare, a.rate_hz);
  declare.required("--out", a.out, "the recording, FILE.palrec");
  declare.rare().choice("--flush", a.flush, {"disk", "system"},
                        "where each quarter of a second is written before the next: disk survives a loss of "
                        "power, system only the end of the program (default: disk)");
  declare.flag("--accelerated", a.accelerated,
               "on a virtual clock, as fast as possible: the same session every time");
  declare_force(declare, a.force);
  declare_json(declare, a.json);
  declare_surface(declare, a.surface);
  declare_model(declare, a.load);
}

void declare_serve(const Declaration& declare, BridgeArguments& a) {
  constexpr NumberRange kSeconds{0.0, 86'400.0}, kTimes{1.0, 1000.0}, kForces{0.0, 100.0};
  declare_device(declare, a.device);
  declare.text("--listen", a.listen,
               "ADDRESS:PORT to listen at; 0.0.0.0: all networks, port 0: any free one (default: "
               "127.0.0.1:47800, this machine only)");
  declare.number("--seconds", a.seconds, kSeconds, "how long (default: 0, until stopped)");
  declare_rate(declare, a.rate_hz);
  declare.rare().number("--watchdog-ms", a.watchdog_ms, kTimes,
                        "ms without a command until the force is zero (default: 20)");
  declare.rare().number("--most-age-ms", a.most_age_ms, kTimes,
                        "a command is refused if the state it answers is older than this, ms (default: 20)");
  declare.number("--force-limit", a.force_limit_n, kForces,
                 "largest force, N, whatever is commanded (default: 0, the device's own limit)");
  declare_json(declare, a.json);
}

Result<int> run_serve(const BridgeArguments& arguments, Context& context) {
  return run_bridge(arguments, context);
}

void declare_study(const Declaration& declare, psychophysics::BlindedArguments& a) {
  constexpr NumberRange kTrials{1, psychophysics::kMostTrials};
  declare.required(
      "PLAN", a.plan,
      "a plan (.toml), or an example by its name: abx, same-different, constant, staircase, psi");
  declare.text(
      "--observer", a.observer,
      "who answers: simulated:dprime=1, or simulated:jnd=0.05 where an option is varied (strategy, "
      "slope, lapse, bias, criterion, catch_dprime, missed); machine: a simulated hand and thresholds "
      "of the literature (hand=press, slide or explore, depth, stiffness, force, direction, vibration, "
      "moved, lapse, bias, criterion, strategy); person: answers by keys, feels the device (hand and depth "
      "of a simulated one) (default: simulated:dprime=1)");
  declare_device(declare, a.device);
  declare_rate(declare.rare(), a.rate_hz);
  declare.flag("--accelerated", a.accelerated,
               "a person's session on a simulated device: as fast as possible, answers from standard input");
  declare.rare().flag(
      "--lsl", a.lsl,
      "a person's session: send trials, intervals and answers as markers over Lab Streaming Layer");
  declare.rare().text("--lsl-library", a.lsl_library,
                      "its library (default: liblsl.so.2, as the system finds it)");
  declare.text("--participant", a.participant,
               "code of the participant, a folder each (default: the plan's)");
  declare.integer("--stop-after", a.stop_after, kTrials,
                  "end this session after this many trials; the same command resumes there");
  declare.flag("--power", a.power,
               "only print the trials needed for the plan's power, and the equivalence bound");
  declare.text("--save-plan", a.save_plan, "only write the plan to this new file, for you to change");
  declare.text("--out", a.out, "folder for the results (default: out/study-NAME)");
  declare_json(declare, a.json);
  declare.verbose();
}

}  // namespace

Subcommand live_subcommand() {
  return subcommand(
      "live", "renderers under one hand on a device, simulated or real, switched while they are felt",
      {"palpate live sinusoid:points=10201 --renderers cloud,mesh-godobject --seconds 10 --switch-every 1 "
       "--out "
       "out/live",
       "palpate live sinusoid:points=10201 --renderers cloud,cloud-smooth --device sim:falcon --hand slide "
       "--seconds 60 --switch-every 0.7 --accelerated --out out/slide",
       "palpate live scan.ply --window --up y",
       "palpate live sinusoid:points=10201 --renderers cloud --changes "
       "2:cloud:stiffness=0.8,4:cloud:refine=1 "
       "--seconds 6 --accelerated --out out/changes",
       "palpate live scan.ply --unit m --renderers cloud,cloud-smooth --device falcon --guard-kill-after 50 "
       "--listen 7700"},
      declare_live, run_live);
}

Subcommand record_subcommand() {
  return subcommand(
      "live record", "one renderer under a hand on a device, every tick recorded",
      {"palpate live record sinusoid:points=10201 --renderer cloud --seconds 10 --out session.palrec",
       "palpate live record scan.ply --unit m --device sim:falcon --renderer cloud-smooth --seconds 5 "
       "--accelerated --out falcon.palrec",
       "palpate compare sinusoid:points=10201 --renderers auto --path session.palrec --out out/again"},
      declare_record, run_record);
}

Subcommand serve_subcommand() {
  return subcommand(
      "live serve", "serves a device of this machine to programs on another one, over UDP",
      {"palpate live serve --device sim:omni --seconds 1",
       "palpate live serve --device sim:falcon --listen 127.0.0.1:0 --force-limit 2 --seconds 1 --json"},
      declare_serve, run_serve);
}

Subcommand study_subcommand() {
  return subcommand(
      "study",
      "a blinded study by a plan: ABX, same-different, forced choice, staircases; with a simulated "
      "observer, a machine that feels, or a person",
      {"palpate study abx --observer simulated:dprime=2 --out out/abx",
       "palpate study staircase --observer simulated:jnd=0.05 --out out/staircase",
       "palpate study staircase --observer machine --out out/predicted",
       "palpate study my-study.toml --observer person --device falcon --participant P02",
       "palpate study abx --power"},
      declare_study, psychophysics::run_blinded);
}

}  // namespace palpate::experiments
