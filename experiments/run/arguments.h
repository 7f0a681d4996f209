// What the command line calls PATH and RENDERERS, turned into what the toolkit takes.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/options.h>
#include <palpate/paths.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "toolkit/core/input_file.h"

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

}  // namespace palpate::experiments
