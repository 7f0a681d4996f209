#include "experiments/live/live.h"

#include "experiments/command/common_options.h"
#include "experiments/command/device_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_live(const Declaration& declare, LiveArguments& a) {
  constexpr NumberRange kSeconds{0.1, 86'400.0}, kEvery{0.0, 86'400.0}, kRate{500.0, 8'000.0},
      kFade{1.0, 1'000.0}, kStandIn{0.0, 1e7};
  RunArguments& run = a.run;
  declare.required("SCENE", run.scene, kSceneHelp);
  declare.text(
      "--renderers", run.renderers,
      "A,B,..: each NAME[:option=value...][:label=TEXT], at most 7; the first is felt first (default: "
      "the scene's or the plan's, cloud, and a mesh)");
  declare_device(declare, a.device);
  declare.text(
      "--hand", a.hand,
      "what the simulated hand does: explore by what it feels, follow the path, press, slide or tap; "
      "mouse: goes where the mouse says (default: explore; follow where --path names another than "
      "hand; with --window mouse)");
  declare.text("--grip", a.device.grip,
               "how it holds the device: hand, finger, arm or released (default: hand)");
  declare.number("--seconds", a.seconds, kSeconds,
                 "how long (default: 10; with --window until it is closed)");
  declare.number("--switch-every", a.switch_every_s, kEvery,
                 "seconds after which the next renderer is asked for, again and again (default: 0, never)");
  declare.text(
      "--rule", a.rule,
      "of a switch that free space does not allow at once: wait (a fade in contact, else wait for free "
      "space), refuse (a fade in contact, else refuse) or free (wait for free space) (default: wait)");
  declare.number("--fade", a.fade_ms, kFade, "length of a fade in contact, ms; 100 to 200 (default: 150)");
  declare.text("--changes", a.changes,
               "SECONDS:LABEL:key=value[:key=value..],..: a renderer's options change while it is felt; "
               "stiffness (N/mm) and force_limit (N) too");
  declare.text("--mapping", a.mapping,
               "of the workspace: 1:1, fitted, or mm of the scene for a mm of the device (default: 1:1)");
  declare.number("--rate", a.rate_hz, kRate, "of the servo, whole Hz (default: 1000)");
  declare.flag("--accelerated", a.accelerated,
               "as fast as it goes, on a clock of its own: the same session every time");
  declare.flag(
      "--window", a.window,
      "a window over the session: the cloud, what is felt, plots, switches by buttons; without a device "
      "the mouse is the hand. A scan that is dropped on it is opened");
  declare.text("--up", a.up,
               "what is up in the window: z, y (most scans of objects), x, -z, -y or -x; key u turns it on "
               "(default: as the scene's [view] has it, else z)");
  declare.number(
      "--stand-in", a.stand_in, kStandIn,
      "points of the coarse cloud that is felt in a window until the renderers of a larger scene are "
      "prepared; 0: none (default: 60000)");
  declare.flag(
      "--headless", a.headless,
      "without a window: keys, the network and the device's buttons switch. The only way where no window "
      "is built in");
  declare.text("--listen", a.listen,
               "PORT: hears OSC messages and lines of JSON over UDP from this machine (ADDRESS:PORT: from "
               "others too) that switch, select, cancel, mark and re-arm; 0 finds a port");
  declare.flag("--rearm", a.rearm, "arm again a second after a fault (simulated devices alone)");
  declare.text("--record", a.record, "FILE.palrec: a recording of the session, every renderer of it");
  declare.flag("--force", a.replace, "replace a recording of that name");
  declare.text("--path", run.path,
               "where the hand goes: a file or a generator, as `palpate compare` takes it (default: by the "
               "model's size)");
  declare_traj_columns(declare, run.traj_columns);
  declare_results(declare, run);
  declare_surface(declare, run.surface);
  declare_model(declare, run.load);
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
       "2:cloud:stiffness=0.8,4:cloud:shading=none "
       "--seconds 6 --accelerated --out out/changes",
       "palpate live scan.ply --unit m --renderers cloud,cloud-smooth --device falcon --guard-kill-after 50 "
       "--listen 7700"},
      declare_live, run_live);
}

}  // namespace palpate::experiments
