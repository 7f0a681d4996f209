// Marks in time for whoever records people beside a study: what began, never what it was.
#pragma once

#include <memory>
#include <string>

#include "toolkit/core/result.h"

namespace palpate::experiments::psychophysics {

/// One worker's at a time.
class Markers {
 public:
  Markers() = default;
  Markers(const Markers&) = delete;
  Markers& operator=(const Markers&) = delete;
  virtual ~Markers() = default;
  /// Something happened `seconds_ago`. Nothing by itself.
  virtual void push(const std::string& /*text*/, double /*seconds_ago*/) {}
};

/// Texts of a stream of Lab Streaming Layer, type "Markers", by its library, which is looked for when this is
/// called: `library` is a file or a name that the system knows. The stream is named "Palpate" and its source
/// is `source`. Errors: no library of it, or one that lacks a function; no outlet can be had.
[[nodiscard]] Result<std::unique_ptr<Markers>> lsl_markers(const std::string& library,
                                                           const std::string& source);
inline constexpr const char* kLslLibrary = "liblsl.so.2";

}  // namespace palpate::experiments::psychophysics
