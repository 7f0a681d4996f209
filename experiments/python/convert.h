// Conversions between Python and the toolkit: errors as exceptions, work without the interpreter's lock,
// places, and arrays of numpy that look at the toolkit's memory.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <atomic>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <palpate/clock.h>
#include <palpate/options.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::python {

namespace py = pybind11;

// pybind11 hides its types; what holds one is hidden as well.
#define PALPATE_HIDDEN __attribute__((visibility("hidden")))

/// Throws palpate.Error with its remedy, file and line.
[[noreturn]] void raise(const Error& error);
/// A Python exception in our words, with the file and line that it came from.
[[nodiscard]] Error error_of(py::error_already_set& exception);

template <class T>
T value_of(Result<T> result) {
  if (!result) raise(result.error());
  return *std::move(result);
}
inline void check(const Status& status) {
  if (!status) raise(status.error());
}

/// Lets Ctrl-C stop work that does not hold the interpreter's lock.
class Interruptible final : public Progress {
 public:
  void report(std::string_view /*what*/, double /*fraction*/) override {}
  [[nodiscard]] bool cancelled() const override;
  /// Throws KeyboardInterrupt if there was one. With the interpreter's lock.
  void raise_if_interrupted() const;

 private:
  mutable std::atomic<bool> interrupted_{false};
  mutable std::atomic<std::int64_t> asked_ns_{monotonic_ns()};
};

/// Releases the interpreter's lock. An interpreter that ends waits for it (see wait_at_exit), since a thread
/// that asks a dead one for the lock ends the process.
class PALPATE_HIDDEN Unlocked {
 private:
  struct Counted {
    Counted();  ///< throws while the interpreter ends
    ~Counted();
  };
  Counted counted_;
  py::gil_scoped_release released_;
};
/// Makes the interpreter's end stop and wait for all work without its lock.
void wait_at_exit();

/// The value of `work(progress)`, a Result, which runs without the interpreter's lock; throws its Error.
template <class Work>
auto without_lock(Work&& work) {
  Interruptible progress;
  auto result = [&] {
    const Unlocked unlocked;
    return work(static_cast<Progress&>(progress));
  }();
  progress.raise_if_interrupted();
  return value_of(std::move(result));
}

/// Three numbers from a tuple, list, array or any other sequence. Throws where they are none.
[[nodiscard]] Vec3 vec3_of(py::handle object);
[[nodiscard]] py::tuple tuple_of(const Vec3& v);

/// A finite number of Python, or an Error that names `what`.
[[nodiscard]] double number_of(py::handle object, const char* what);

/// Options from keyword arguments: text, numbers and flags.
[[nodiscard]] Options options_of(const py::dict& given);

/// Shape and strides of an array in memory, bytes.
struct PALPATE_HIDDEN Layout {
  std::vector<py::ssize_t> shape, strides;
};
/// A read-only array that looks at `data`, which `owner` keeps alive.
[[nodiscard]] py::array view_of(const py::dtype& type, Layout layout, const void* data,
                                const py::handle& owner);
/// The same of one member of each of `count` records, `width` values of T each (1: one axis).
template <class T, class Record>
[[nodiscard]] py::array member_view(const std::vector<Record>& records, const void* first, py::ssize_t width,
                                    const py::handle& owner) {
  Layout layout{{static_cast<py::ssize_t>(records.size())}, {static_cast<py::ssize_t>(sizeof(Record))}};
  if (width > 1) {
    layout.shape.push_back(width);
    layout.strides.push_back(static_cast<py::ssize_t>(sizeof(T)));
  }
  return view_of(py::dtype::of<T>(), std::move(layout), records.empty() ? nullptr : first, owner);
}

/// An (n, 3) array of doubles, row after row; `given` itself where it is one. Throws in our words otherwise.
[[nodiscard]] py::array_t<double, py::array::c_style> rows_of_three(py::handle given, const char* what);
/// Its rows as the toolkit reads them; valid as long as the array.
[[nodiscard]] std::span<const Vec3> vectors_of(const py::array_t<double, py::array::c_style>& rows);

/// palpate.Frame, a named tuple: force, god_object, contact, model, status.
void add_frame_type(py::module_& module);
[[nodiscard]] py::object frame_object(const render::Frame& frame);

}  // namespace palpate::python
