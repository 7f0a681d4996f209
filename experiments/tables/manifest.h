// One manifest per table of the thesis: what is run, and what is printed there.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/core/result.h"

namespace palpate::experiments {

struct EmbeddedManifest {
  const char* name;
  const char* text;
};
/// The files of experiments/tables, as they were when the program was built.
[[nodiscard]] std::span<const EmbeddedManifest> embedded_manifests();
/// Those of experiments/scenes.
[[nodiscard]] std::span<const EmbeddedManifest> embedded_scenes();

struct ManifestModel {
  std::string name;
  std::string scene;     ///< one of the embedded scenes; or
  std::string generate;  ///< a generator with options; or
  std::string scan;      ///< a scan known by name
  std::string stand_in;  ///< the embedded scene that is run, and called so, where the first cannot be had
  std::string quick;     ///< the generator of a quick trial; empty: the same
  std::string unit;
  double scale = 1.0;
  bool if_room = false;               ///< growth: without --full only where the ten minutes leave room
  std::optional<double> printed_min;  ///< table 6: minutes
  std::string path;                   ///< table 11: instead of the manifest's
  bool full = false;                  ///< table 11 and protocols: with --full only
  std::string sample;             ///< protocols: points in its faces (scene key `sample`); an @ is the seed
  std::string quick_sample;       ///< of a quick trial; empty: the same
  std::string reference;          ///< protocols: the scan whose faces are the truth; empty: its own
  std::uint64_t seeds = 0;        ///< protocols: so many, put in place of each @; 0: one
  std::vector<std::string> slow;  ///< tables 6 and 11: builders or rows that run with --full only here
  std::vector<std::string> only;  ///< table 11: the rows that run on this model; empty: all
  std::string in_time;            ///< table 3: the generator of a run of minutes; --full takes `generate`
  std::uint64_t points_in_time = 0;  ///< table 3: so many of its points in a run of minutes; 0: all
};

/// Table 11: a method, in the words of the table.
struct ManifestMethod {
  std::string renderer;  ///< with its options
  std::string label;     ///< as a row; the renderer's name where empty
  std::string kin;       ///< what it stands for in the thesis
  std::string preparation, broad, narrow, response;
  struct Published {
    double points = 0.0, us = 0.0;
  };
  std::vector<Published> published;  ///< mean frames that its authors report
};

/// A row of table 3.
struct PrintedMesh {
  std::string method, model, time, machine;
  std::vector<double> minutes;  ///< the printed time, or its ends where a range is printed
  std::string kin;              ///< the one of our methods that is nearest to it
  std::string ours;             ///< the model of ours that is nearest to its
};

struct ManifestRun {
  std::string renderer;
  std::string quick;  ///< of a quick trial; empty: the same
};

struct Manifest {
  int table = 0;  ///< 0: none of the thesis's
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
  std::string source;  ///< the text that it was read from
  std::string title, text;
  std::vector<std::string> notes;
  std::string hardware;  ///< of the printed values
  std::uint64_t printed_points = 0, printed_frames = 0;
  double printed_min_ms = 0.0, printed_max_ms = 0.0, printed_mean_ms = 0.0;
  std::vector<ManifestModel> models;
  std::vector<double> wall_spacings;  ///< table 6: walls to find wrong links through, in spacings
  std::string path, quick_path;
  std::string scan_path;             ///< instead of `path` on a scan, which has no formula; empty: the same
  std::uint64_t contact_frames = 0;  ///< the path ends after so many
  std::vector<ManifestRun> runs;
  std::vector<ManifestMethod> methods;
  bool paced = true;  ///< frames are timed at 1 kHz too; false: with --full only
  std::vector<PrintedMesh> printed_meshes;

  /// "table7", "growth": its folder, its section, its step.
  [[nodiscard]] std::string id() const;
};

/// Strict: a key that is not known, or does nothing for the kind, is an Error with its line.
[[nodiscard]] Result<Manifest> parse_manifest(std::string_view text, const std::string& name);

/// Those asked for: tables by number, "growth", and files by name ("6,7,mine.toml"); empty: all that are
/// built in, in order. An Error for one that is not known names those there are.
[[nodiscard]] Result<std::vector<Manifest>> manifests_for(const std::string& tables);

}  // namespace palpate::experiments
