#include "experiments/command/common_options.h"
#include "experiments/command/device_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/live/recording_session.h"

namespace palpate::experiments {
namespace {

void declare_record(const Declaration& declare, RecordArguments& a) {
  constexpr NumberRange kSeconds{0.0, 86'400.0, true};
  constexpr NumberRange kRates{500, 8000};
  declare.required("SCENE", a.scene, kSceneHelp);
  declare.text("--renderer", a.renderer,
               "NAME[:option=value...]; default: the scene's, or what `palpate plan` chooses");
  declare_device(declare, a.device);
  declare.text("--hand", a.device.grip, "the simulated hand: hand, finger or arm (default: hand)");
  declare.text("--path", a.path,
               "the goal that the hand steers to: a file or a generator, as `palpate compare` takes it "
               "(default: by the model's size, as long as the session)");
  declare_traj_columns(declare, a.traj_columns);
  declare.number("--seconds", a.seconds, kSeconds, "length of the session (default: 10)");
  declare.integer("--rate", a.rate_hz, kRates, "of the servo, Hz (default: 1000)");
  declare.text("--out", a.out, "the recording, FILE.palrec");
  declare.choice("--flush", a.flush, {"disk", "system"},
                 "how far each chunk of a quarter of a second goes before the next: disk survives a loss of "
                 "power, system the end of the program alone (default: disk)");
  declare.flag("--accelerated", a.accelerated,
               "on a virtual clock, as fast as it goes: the same session every time");
  declare.flag("--force", a.force, "a recording of this name may be replaced");
  declare.flag("--json", a.json, "print the result as JSON");
  declare_surface(declare, a.surface);
  declare_model(declare, a.load);
}

int run_record_command(const RecordArguments& arguments, Context& context) {
  if (arguments.out.empty())
    return fail({"there is nowhere to record to", "give --out FILE.palrec", {}, 0}, kExitBadInput);
  return run_record(arguments, context);
}

}  // namespace

Subcommand record_subcommand() {
  return subcommand(
      "record", "one renderer under a hand on a device, every tick recorded",
      {"palpate record sinusoid:points=10201 --renderer cloud --seconds 10 --out session.palrec",
       "palpate record scan.ply --unit m --device sim:falcon --renderer cloud-smooth --seconds 5 "
       "--accelerated --out falcon.palrec",
       "palpate replay sinusoid:points=10201 --path session.palrec --out out/again"},
      declare_record, run_record_command);
}

}  // namespace palpate::experiments
