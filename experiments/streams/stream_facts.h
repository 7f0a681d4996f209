// Facts of a stream of depth images, for `palpate info`.
#pragma once

#include <string>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "toolkit/stream/stream_statistics.h"

namespace palpate::experiments {

struct StreamFacts {
  std::string source, about;
  stream::DepthCamera camera;
  stream::StreamStatistics statistics;
};

/// Whether the name means a stream: a folder, a simulated camera or a real one. Recorded sessions are told
/// apart by what they hold.
[[nodiscard]] bool is_stream_name(const std::string& name);

/// Reads up to stream::kStatisticsFrames images.
[[nodiscard]] Result<StreamFacts> facts_of_stream(const std::string& name, const io::Readers& readers,
                                                  Progress& progress);
/// For a terminal.
[[nodiscard]] std::string to_text(const StreamFacts& facts);
/// An object of docs/schemas/info.schema.json.
[[nodiscard]] std::string to_json(const StreamFacts& facts);

}  // namespace palpate::experiments
