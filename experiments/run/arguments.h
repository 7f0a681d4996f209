// PATH and RENDERERS of the command line, as toolkit types.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/options.h>
#include <palpate/paths.h>
#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/scene.h>
#include <palpate/trace.h>
#include "toolkit/core/files.h"

namespace palpate::experiments {

/// One renderer to run, under a label that is unique in its run.
struct RendererRequest {
  std::string label;
  std::string name;
  Options options;                    ///< as given
  std::vector<NamedOptions> clean{};  ///< steps of cleaning before it is prepared, checked
};

/// "cloud,mesh-godobject:mesh=original:label=file-mesh,cloud:clean=outliers+smooth:label=cleaned". Names and
/// options are checked against the registry; labels must be unique and fit a file name.
[[nodiscard]] Result<std::vector<RendererRequest>> parse_renderers(std::string_view text,
                                                                   const render::Registry& registry);
[[nodiscard]] Result<RendererRequest> request_of(NamedOptions named, const render::Registry& registry);

/// The columns of a recording that open_path() takes: which hold time and position, and their units.
[[nodiscard]] const std::vector<OptionSpec>& recording_columns();

/// A CSV file, a recording of a session (.palrec), one of numbers in columns, whatever its ending
/// ("probe.txt:t=0:x=1:mm_per_unit=1000"), or a path generator. A recorded one takes at most `max_bytes` of
/// memory; what is missing in it is said in `warnings`, where that is given.
[[nodiscard]] Result<trace::ProbePath> open_path(const std::string& argument, const paths::PathTarget& target,
                                                 std::uint64_t max_bytes = kMemoryLimitBytes,
                                                 std::vector<std::string>* warnings = nullptr);
/// Whether the file at this name is a recording of a session.
[[nodiscard]] bool is_recorded_session(const std::string& argument);
/// The file that open_path() reads; empty where it makes the path.
[[nodiscard]] std::string file_of_path(const std::string& argument);
/// Whether open_path() would make it: no file of this name, but a generator.
[[nodiscard]] bool is_generated_path(const std::string& argument);

// A recording as a probe path: where the renderers' HIP went, call by call.

struct RecordedPath {
  trace::ProbePath path;
  std::vector<std::string> warnings;  ///< what is missing in the recording, whole sentences
};

/// The steps of the first renderer that was stepped in each tick, the small ones of a bring-up among them.
/// Where a renderer let go at a place known to be free, the path goes by that place, half way in time between
/// its neighbours: so it starts free, and does not cut through a surface between two segments. Steps whose
/// HIP is not finite, or whose time does not go on, are left out. At most `max_bytes` of memory.
[[nodiscard]] Result<RecordedPath> path_of_recording(const std::string& file, std::uint64_t max_bytes);

// --stiffness, --friction and --deformation: what the command line says of surfaces.

/// As typed; empty: as the scene says.
struct SurfaceArguments {
  std::string stiffness;    ///< N/mm
  std::string friction;     ///< one coefficient, or static,dynamic
  std::string deformation;  ///< 0 up to 1

  [[nodiscard]] bool any() const { return !(stiffness.empty() && friction.empty() && deformation.empty()); }
};

/// Notes on the values that were put in.
struct SurfaceReport {
  std::vector<std::string> notes;     ///< what holds now
  std::vector<std::string> warnings;  ///< where it does not hold
};

/// Puts the values in place of the uniform ones of every model. Values that cannot be, and models whose value
/// comes from a column or an image, are Errors; a region that has its own value keeps it, which is a warning.
[[nodiscard]] Result<SurfaceReport> set_surfaces(const SurfaceArguments& arguments, scene::SceneFile& scene);

// Files that the user names to be written: whether they may be.

/// A file that a command is asked to write.
struct OutputFile {
  std::string path;
  std::vector<std::string> endings;  ///< of the formats that can be written, without the dot
  bool force = false;                ///< replaces also what is somebody else's, or read
};

/// Errors: the ending stands for no format that is written; the folder is missing; `path` is no plain file
/// (whatever `force` says); it is one of the files `read` by the command, under whatever name; it is there
/// and Palpate did not write it. A file that Palpate wrote is replaced.
[[nodiscard]] Status check_output(const OutputFile& file, std::span<const std::string> read);

// Defaults for a user who names a model alone: renderers to compare, a path, a folder.

/// As deep and as fast as the model's size asks for: what a hand does on its points, or an exploration of
/// them where nothing is there to be felt; on a formula a Lissajous curve with many entries, for an
/// exploration also leaves the part of it that was sampled, where a formula goes on and the points do not. A
/// path generator with its options.
inline constexpr int kUsualFrames = 20'000;  ///< twenty seconds
[[nodiscard]] std::string usual_path(const paths::PathTarget& target, int frames = kUsualFrames);

/// Warning about a model's size for a hand, a whole sentence with a remedy; empty where it fits.
[[nodiscard]] std::string size_hint(const geometry::Aabb& box_mm);

/// Of the points without faces so many are meshed: a quarter of a minute at the 46 µs a point that advancing
/// front takes, a minute on the raw layers of several scans (docs/how-to/prepare-a-scan.md).
/// Larger models are thinned for the mesh.
inline constexpr double kMostPointsMeshed = 300'000;

struct Chosen {
  std::vector<RendererRequest> renderers;
  std::vector<std::string> notes;  ///< whole sentences
};
/// The scene's own renderer, or the plan's choice; `cloud`; and a god object on the best mesh that is made in
/// reasonable time: the models' own faces, else the scanner's rows connected, else a reconstruction. Those
/// that lack what the scene asks for are left out, and a note says so.
[[nodiscard]] Chosen usual_renderers(const render::SceneInput& scene,
                                     const std::optional<RendererRequest>& own,
                                     const render::Registry& registry);

/// "out/COMMAND-NAME", by the model's name; with -2, -3, .. where that holds something else than results of
/// the same scene.
[[nodiscard]] std::string usual_folder(const std::string& command, const std::string& scene);

}  // namespace palpate::experiments
