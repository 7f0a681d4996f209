#include "experiments/command/common_options.h"

#include <fmt/format.h>

#include "toolkit/core/message_text.h"
#include "toolkit/core/physical_ranges.h"

namespace palpate::experiments {

void declare_threads(const Declaration& declare, int& threads) {
  declare.shared().integer("--threads", threads, kThreads, "threads of preparation (default: all)");
}

void declare_json(const Declaration& declare, bool& json) {
  declare.shared().flag("--json", json, "print the result as JSON");
}

void declare_force(const Declaration& declare, bool& force) {
  declare.shared().flag("--force", force,
                        "what is written may replace what is read, or what Palpate did not write");
}

void declare_out(const Declaration& declare, std::string& out) {
  declare.shared().text("--out", out, "folder for the results (default: one in out/, by the model's name)");
}

void declare_required_out(const Declaration& declare, std::string& out) {
  declare.shared().required("--out", out, "folder for the results; an interrupted run in it is gone on with");
}

void declare_renderers(const Declaration& declare, std::string& renderers, const std::string& usual) {
  declare.text("--renderers", renderers,
               "A,B,..: each NAME[:option=value..][:label=TEXT] (default: " + usual + ")");
}

void declare_renderer(const Declaration& declare, std::string& renderer) {
  declare.text("--renderer", renderer, "NAME[:option=value..] (default: the scene's, or the plan's choice)");
}

void declare_path(const Declaration& declare, std::string& path, const std::string& usual) {
  declare.text(
      "--path", path,
      "a file or a generator such as weave:frames=20000, of `palpate list paths` (default: " + usual + ")");
}

void declare_reference(const Declaration& declare, std::string& reference) {
  declare.rare().text("--reference", reference,
                      "ground truth: auto, analytic, original-mesh, closest-point, none, or a mesh file or "
                      "scan by name in the model's frame");
}

void declare_model(const Declaration& declare, ModelArguments& load) {
  const Declaration rare = declare.rare();
  declare.shared().text("--unit", load.unit,
                        "of the model file: m, cm, mm, um, in (default: what the file says)");
  rare.number("--scale", load.scale, kScales,
              "multiplies all lengths, after the unit (default: 1, or the scene's)");
  rare.number("--post-mm", load.post_mm, kLengthsMm,
              "height grids: distance of their posts in mm, before --scale (default: what the file says)");
  rare.number("--vertical-mm", load.vertical_mm, kLengthsMm,
              "height grids: mm that a height of 1 stands for, before --scale (default: the unit)");
  rare.text("--no-data", load.no_data,
            "height grids: the file's number that stands for no height (default: what the file says)");
  rare.choice("--non-finite", load.non_finite, {"drop", "refuse"},
              "points that are not finite: drop (and count) or refuse (default: drop)");
  rare.number("--memory-limit-gb", load.memory_limit_gb, kGigabytes,
              fmt::format("memory that reading one file may take (default: {:.3g})",
                          static_cast<double>(kMemoryLimitBytes) / kBytesPerGb));
  declare_threads(declare, load.threads);
}

void declare_surface(const Declaration& declare, SurfaceArguments& surface) {
  const Declaration shared = declare.shared();
  shared.text("--stiffness", surface.stiffness, "of every model, N/mm (default: 0.5, or the scene's)");
  shared.text("--friction", surface.friction,
              "of every model: a coefficient, or STATIC,DYNAMIC (default: none, or the scene's)");
  shared.text("--deformation", surface.deformation,
              "of every model: share of the force it takes away, below 1 (default: the scene's)");
}

void declare_scene_run(const Declaration& declare, RunArguments& run) {
  declare_reference(declare, run.reference);
  declare_out(declare, run.out);
  declare_json(declare, run.json);
  declare.verbose();
  declare_surface(declare, run.surface);
  declare_model(declare, run.load);
}

void declare_trade(const Declaration& declare, SweepArguments& trade) {
  RunArguments& run = trade.run;
  run.passes = kSweepPasses;
  declare.required("SCENE", run.scene, kSceneHelp);
  declare_renderers(declare, run.renderers, "all that can do what the scene asks for");
  declare.text("--axes", trade.axes,
               "what is turned, separated by commas: " + joined(names_of(axes())) + " (default: all)");
  declare_path(declare, run.path, "six seconds, by the model's size");
  declare.rare().integer(
      "--passes", run.passes, kPasses,
      fmt::format("timed passes of each kind and setting, in turns (default: {})", kSweepPasses));
  declare_reference(declare, run.reference);
  declare_out(declare, run.out);
  declare_json(declare, run.json);
  declare_model(declare, run.load);
}

void declare_device(const Declaration& declare, DeviceArguments& device) {
  declare.text("--device", device.device,
               "sim, or sim:NAME with omni, touch, falcon, omega3 or admittance, or one of `palpate list "
               "devices` (default: sim, which is sim:omni)");
  declare.text("--grip", device.grip,
               "how a simulated hand holds it: hand, finger, arm or released (default: hand)");
  declare_device_details(declare, device);
}

void declare_device_details(const Declaration& declare, DeviceArguments& device) {
  constexpr NumberRange kKillAfter{0.0, 10'000.0};
  const Declaration rare = declare.rare();
  rare.text("--device-file", device.file, "a device description, for drivers that take one");
  rare.repeated("--device-option", device.options,
                "KEY=VALUE for the device's driver; may be given again for others");
  rare.number("--guard-kill-after", device.guard_kill_after_ms, kKillAfter,
              "ms without a tick after which the guard process of a real device kills this program and "
              "commands zero: it hangs or was stopped (default: 0, never)");
}

}  // namespace palpate::experiments
