#include <palpate/progress.h>

namespace palpate {
namespace {

class Silent final : public Progress {
 public:
  void report(std::string_view, double) override {}
};

}  // namespace

Progress& no_progress() noexcept {
  static Silent silent;
  return silent;
}

}  // namespace palpate
