// Options and lists that several subcommands share: renderers, cleaning steps, path generators.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <palpate/options.h>
#include <palpate/result.h>
#include "experiments/command/subcommand.h"
#include "experiments/driver/study_run.h"
#include "experiments/live/session_device.h"
#include "experiments/trade/sweep.h"

namespace palpate::experiments {

inline constexpr NumberRange kThreads{0, 4096};       ///< more than any machine has
inline constexpr NumberRange kGigabytes{0.001, 1e6};  ///< a petabyte: beyond every machine
inline constexpr NumberRange kServoRates{500, 8000};  ///< Hz
inline constexpr NumberRange kPasses{1, 1000};

inline constexpr const char* kStudyFolderHelp =
    "the folder of a study: --out of compare, or a table's folder within that of reproduce";
inline constexpr const char* kSceneHelp =
    "a scene (.toml), a model file, a scan by name (`palpate list scans`), or a generator such as "
    "sinusoid:points=10201";

void declare_threads(const Declaration& declare, int& threads);
void declare_json(const Declaration& declare, bool& json);
/// --force, of files that may be replaced.
void declare_force(const Declaration& declare, bool& force);
/// --out as a folder that may be left out, and one that may not.
void declare_out(const Declaration& declare, std::string& out);
void declare_required_out(const Declaration& declare, std::string& out);
/// --renderers; `usual`: those that are taken where none is given.
void declare_renderers(const Declaration& declare, std::string& renderers, const std::string& usual);
void declare_renderer(const Declaration& declare, std::string& renderer);
/// Options of reading models.
void declare_model(const Declaration& declare, ModelArguments& load);
/// SCENE, which --stream may replace, and --stream.
void declare_scene_or_stream(const Declaration& declare, RunArguments& run);
/// --path; `usual`: what is taken where none is given.
void declare_path(const Declaration& declare, std::string& path, const std::string& usual);
void declare_reference(const Declaration& declare, std::string& reference);
/// The truth, --out, --json, --verbose, surfaces and how models are read: of what runs a scene.
void declare_scene_run(const Declaration& declare, RunArguments& run);
void declare_surface(const Declaration& declare, SurfaceArguments& surface);
/// Those of sweep and tune.
void declare_trade(const Declaration& declare, SweepArguments& trade);

/// --device and --grip, and what follows.
void declare_device(const Declaration& declare, DeviceArguments& device);
/// --device-file, --device-option, --guard-kill-after, where another option names the device.
void declare_device_details(const Declaration& declare, DeviceArguments& device);
/// --rate of the servo.
template <class Rate>
void declare_rate(const Declaration& declare, Rate& rate_hz) {
  constexpr const char* kHelp = "rate of the servo loop, whole Hz (default: 1000)";
  if constexpr (std::is_floating_point_v<Rate>)
    declare.number("--rate", rate_hz, kServoRates, kHelp);
  else
    declare.integer("--rate", rate_hz, kServoRates, kHelp);
}

struct CatalogueEntry {
  std::string name;
  std::string summary;
  std::string source;  ///< may be empty
  std::span<const OptionSpec> options;
  std::string role{}, works_on{};       ///< of renderers: render::Role and render::Geometry
  std::vector<std::string> supports{};  ///< of renderers: what a scene may ask of it
  std::string models{};                 ///< on which it works, where that must be said
  std::string example{};                ///< as on a command line; may be empty
};

/// Keeps the one of this name alone; all where it is empty. An Error where there is none, with what may have
/// been meant.
[[nodiscard]] Status keep_named(std::vector<CatalogueEntry>& entries, const std::string& name);

/// For a person: a line each, of a single one all there is to say. Or all of it as JSON.
void print_catalogue(std::span<const CatalogueEntry> entries, bool json);

}  // namespace palpate::experiments
