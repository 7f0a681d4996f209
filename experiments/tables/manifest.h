// Manifests of the thesis's tables: what is run, and the printed values.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/result.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::experiments {

struct EmbeddedManifest {
  const char* name;
  const char* text;
};
/// Files of experiments/tables at build time.
[[nodiscard]] std::span<const EmbeddedManifest> embedded_manifests();
/// Files of experiments/scenes at build time.
[[nodiscard]] std::span<const EmbeddedManifest> embedded_scenes();

struct ManifestModel {
  std::string name;
  std::string scene;     ///< an embedded scene; or
  std::string generate;  ///< a generator with options; or
  std::string scan;      ///< a known scan's name
  std::string stand_in;  ///< embedded scene used, and named in the results, if the first is unavailable
  std::string quick;     ///< generator for --quick; empty: the same
  std::string unit;
  double scale = 1.0;
  bool long_run = false;              ///< growth: needs minutes: only with --full, or where it is named
  std::optional<double> printed_min;  ///< table 6: minutes
  std::string path;                   ///< table 11: replaces the manifest's
  bool full = false;                  ///< table 11 and protocols: only with --full
  std::string sample;                 ///< protocols: points in its faces (scene key `sample`); @ is the seed
  std::string quick_sample;           ///< for --quick; empty: the same
  std::string reference;              ///< protocols: scan whose faces are the truth; empty: its own
  std::uint64_t seeds = 0;            ///< protocols: number of seeds for each @; 0: one
  std::vector<std::string> slow;      ///< tables 6 and 11: builders or rows only with --full
  std::vector<std::string> only;      ///< table 11: this model's rows; empty: all
  std::string in_time;                ///< table 3: generator for runs of minutes; --full uses `generate`
  std::uint64_t points_in_time = 0;   ///< table 3: number of its points in runs of minutes; 0: all
};

/// Table 11: a method in the table's words.
struct ManifestMethod {
  std::string renderer;  ///< with options
  std::string label;     ///< row label; empty: the renderer's name
  std::string kin;       ///< the thesis method it represents
  std::string preparation, broad, narrow, response;
  struct Published {
    double points = 0.0, us = 0.0;
  };
  std::vector<Published> published;  ///< mean frames reported by its authors
};

/// A row of table 3.
struct PrintedMesh {
  std::string method, model, time, machine;
  std::vector<double> minutes;  ///< printed time, or both ends of a range
  std::string kin;              ///< our nearest method
  std::string ours;             ///< our model nearest to its
};

struct ManifestRun {
  std::string renderer;
  std::string quick;  ///< for --quick; empty: the same
};

struct Manifest {
  int table = 0;  ///< 0: not from the thesis
  enum class Kind {
    kFrames,
    kNeighbours,
    kMethods,
    kMeshes,
    kGrowth,
    kBehaviours,
    kLadder,
    kOffVertex,
    kScanner
  };
  Kind kind = Kind::kFrames;
  std::string kind_name;
  std::string source;  ///< the text it was parsed from
  std::string title, text;
  std::vector<std::string> notes;
  std::string hardware;  ///< of the printed values
  std::uint64_t printed_points = 0, printed_frames = 0;
  double printed_min_ms = 0.0, printed_max_ms = 0.0, printed_mean_ms = 0.0;
  std::vector<ManifestModel> models;
  std::vector<double> wall_spacings;  ///< table 6: walls for counting wrong links, in spacings
  std::string path, quick_path;
  std::string scan_path;             ///< replaces `path` on a scan, which has no formula; empty: the same
  std::uint64_t contact_frames = 0;  ///< contact frames after which the path ends
  std::vector<ManifestRun> runs;
  std::vector<ManifestMethod> methods;
  bool paced = true;  ///< also times frames at 1 kHz; false: only with --full
  std::vector<PrintedMesh> printed_meshes;

  /// "table7", "growth": names its folder, section and step.
  [[nodiscard]] std::string id() const;
};

/// Error with line: a key that is unknown or without effect for the kind.
[[nodiscard]] Result<Manifest> parse_manifest(std::string_view text, const std::string& name);

/// Selects tables by number, "growth", and files by name ("6,7,mine.toml"); empty: all built-in ones, in
/// order. Error: an unknown one, with the list of known ones.
[[nodiscard]] Result<std::vector<Manifest>> manifests_for(const std::string& tables);

}  // namespace palpate::experiments
