#include "toolkit/stream/depth_source.h"

#include <cmath>
#include <filesystem>

#include "toolkit/core/messages.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/stream/depth_folder.h"
#include "toolkit/stream/openni_source.h"
#include "toolkit/stream/simulated_camera.h"

namespace palpate::stream {
Result<std::unique_ptr<DepthSource>> open_depth_source(const std::string& source,
                                                       const DepthSourceOptions& options) {
  const auto in = [](double value, const NumberRange& range) { return value >= 0.0 && value <= range.high; };
  if (!in(options.rate_hz, kRatesHz))
    return Error{"the rate of a stream is no number of frames a second", "give a rate " + text_of(kRatesHz)};
  if (!in(options.unit_mm_per_count, kScales))
    return Error{"the unit of depths is no length", "give the millimetres of one count, such as 1 or 0.2"};
  std::error_code none;
  if (std::filesystem::is_directory(source, none)) return open_depth_folder(source, options);
  if (source.starts_with(kSimulatedPrefix)) return open_simulated_camera(source);
  if (is_openni_name(source)) return open_openni(source);
  return Error{"there is no stream '" + source + "'",
               "give a folder of depth images or organised PCD files, sim:NAME, or openni"};
}

}  // namespace palpate::stream
