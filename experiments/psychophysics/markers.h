// Time markers for external recorders: event times, never which renderer was felt.
#pragma once

#include <memory>
#include <string>

#include <palpate/result.h>

namespace palpate::experiments::psychophysics {

/// One worker at a time.
class Markers {
 public:
  Markers() = default;
  Markers(const Markers&) = delete;
  Markers& operator=(const Markers&) = delete;
  virtual ~Markers() = default;
  /// Marks an event `seconds_ago`. Does nothing here.
  virtual void push(const std::string& /*text*/, double /*seconds_ago*/) {}
};

/// Sends markers as a Lab Streaming Layer stream of type "Markers", named "Palpate", with source `source`.
/// Loads liblsl at this call: `library` is a file or a name that the system can resolve. Errors: library or
/// function missing; no outlet available.
[[nodiscard]] Result<std::unique_ptr<Markers>> lsl_markers(const std::string& library,
                                                           const std::string& source);
inline constexpr const char* kLslLibrary = "liblsl.so.2";

}  // namespace palpate::experiments::psychophysics
