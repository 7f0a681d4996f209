#include "experiments/python/convert.h"

#include <fmt/format.h>
#include <structseq.h>

#include <array>
#include <chrono>
#include <cmath>
#include <span>
#include <thread>

namespace palpate::python {
namespace {

constexpr std::int64_t kSignalsEveryNs = 50'000'000;  // a user waits this long unnoticed

constexpr std::chrono::milliseconds kExitLooksEvery{1};

std::atomic<int> unlocked_calls{0};
std::atomic<bool> ending{false};
std::thread::id ending_thread;  // written before `ending`

/// A daemon thread that comes back while the interpreter ends would print an exception into files that are
/// being closed, which aborts the process. It never comes back, as in Python's own calls.
void stay_if_ending() {
  if (!ending || std::this_thread::get_id() == ending_thread) return;
  const py::gil_scoped_release released;
  while (true) std::this_thread::sleep_for(kExitLooksEvery);
}

py::object error_type() {
  return py::module_::import("palpate.errors").attr("Error");
}

/// The item as a double; a failed conversion clears Python's error.
bool read_double(PyObject* item, double& value) {
  value = PyFloat_AsDouble(item);
  if (value == -1.0 && PyErr_Occurred() != nullptr) {
    PyErr_Clear();
    return false;
  }
  return true;
}

/// Any sequence of three: what neither a tuple nor an array of doubles is.
bool read_sequence(PyObject* object, Vec3& v) {
  if (PySequence_Check(object) == 0 || PyUnicode_Check(object) != 0) return false;
  const Py_ssize_t size = PySequence_Size(object);
  if (size < 0) PyErr_Clear();
  if (size != 3) return false;
  for (int axis = 0; axis < 3; ++axis) {
    const auto item = py::reinterpret_steal<py::object>(PySequence_GetItem(object, axis));
    if (!item) {
      PyErr_Clear();
      return false;
    }
    if (!read_double(item.ptr(), v[axis])) return false;
  }
  return true;
}

/// One axis of three doubles, as numpy has them.
bool read_buffer(PyObject* object, Vec3& v) {
  if (PyObject_CheckBuffer(object) == 0) return false;
  Py_buffer buffer;
  if (PyObject_GetBuffer(object, &buffer, PyBUF_FORMAT | PyBUF_STRIDES) != 0) {
    PyErr_Clear();
    return false;
  }
  const bool fits = buffer.ndim == 1 && buffer.shape[0] == 3 && buffer.format != nullptr &&
                    std::string_view(buffer.format) == "d";
  if (fits)
    for (int axis = 0; axis < 3; ++axis)
      std::memcpy(&v[axis], static_cast<const char*>(buffer.buf) + axis * buffer.strides[0], sizeof(double));
  PyBuffer_Release(&buffer);
  return fits;
}

}  // namespace

void raise(const Error& error) {
  const py::object type = error_type();
  const py::object raised = type(error.what, error.remedy, error.file, error.line);
  PyErr_SetObject(type.ptr(), raised.ptr());
  throw py::error_already_set();
}

Error error_of(py::error_already_set& exception) {
  const py::object& value = exception.value();
  if (py::isinstance(value, error_type()))
    return {value.attr("what").cast<std::string>(), value.attr("remedy").cast<std::string>(),
            value.attr("file").cast<std::string>(), value.attr("line").cast<std::int64_t>()};
  Error error;
  // A class may fail even to say what went wrong.
  const auto text = py::reinterpret_steal<py::object>(PyObject_Str(value.ptr()));
  if (!text) PyErr_Clear();
  const auto name = exception.type().attr("__name__").cast<std::string>();
  error.what = text ? fmt::format("{}: {}", name, text.cast<std::string>()) : name;
  error.remedy = "mend the renderer's class";
  py::object trace = exception.trace() ? py::reinterpret_borrow<py::object>(exception.trace()) : py::none();
  while (!trace.is_none()) {
    error.file = trace.attr("tb_frame").attr("f_code").attr("co_filename").cast<std::string>();
    error.line = trace.attr("tb_lineno").cast<std::int64_t>();
    trace = trace.attr("tb_next");
  }
  return error;
}

Unlocked::Counted::Counted() {
  stay_if_ending();
  if (ending) raise({"the interpreter ends", "wait for the thread before that"});
  ++unlocked_calls;
}
Unlocked::Counted::~Counted() {
  --unlocked_calls;
  stay_if_ending();
}

void wait_at_exit() {
  py::module_::import("atexit").attr("register")(py::cpp_function([] {
    ending_thread = std::this_thread::get_id();
    ending = true;
    const py::gil_scoped_release released;
    while (unlocked_calls > 0) std::this_thread::sleep_for(kExitLooksEvery);
  }));
}

bool Interruptible::cancelled() const {
  if (ending) return true;
  const std::int64_t now_ns = monotonic_ns();
  if (!interrupted_ && now_ns - asked_ns_ > kSignalsEveryNs) {
    asked_ns_ = now_ns;
    const py::gil_scoped_acquire lock;
    if (PyErr_CheckSignals() != 0) {
      PyErr_Clear();
      interrupted_ = true;
    }
  }
  return interrupted_;
}

void Interruptible::raise_if_interrupted() const {
  if (!interrupted_) return;
  PyErr_SetNone(PyExc_KeyboardInterrupt);
  throw py::error_already_set();
}

Vec3 vec3_of(py::handle object) {
  Vec3 v;
  PyObject* const given = object.ptr();
  if (PyTuple_CheckExact(given) != 0 && PyTuple_GET_SIZE(given) == 3) {
    if (read_double(PyTuple_GET_ITEM(given, 0), v[0]) && read_double(PyTuple_GET_ITEM(given, 1), v[1]) &&
        read_double(PyTuple_GET_ITEM(given, 2), v[2]))
      return v;
  } else if (read_buffer(given, v) || read_sequence(given, v)) {
    return v;
  }
  raise({"this is no place: it needs three numbers", "give a tuple, a list or an array of three, in mm"});
}

py::tuple tuple_of(const Vec3& v) {
  return py::make_tuple(v.x(), v.y(), v.z());
}

double number_of(py::handle object, const char* what) {
  double value = 0.0;
  if (!read_double(object.ptr(), value) || !std::isfinite(value))
    raise({fmt::format("{} is no finite number", what), "give one"});
  return value;
}

Options options_of(const py::dict& given) {
  Options options;
  for (const auto& [key, value] : given) {
    std::string text;
    if (py::isinstance<py::bool_>(value)) {
      text = value.cast<bool>() ? "true" : "false";
    } else if (py::isinstance<py::str>(value)) {
      text = value.cast<std::string>();
    } else if (PyNumber_Check(value.ptr()) != 0) {
      // As Python prints it, so that 5 stays an integer.
      text = py::str(py::hasattr(value, "item") ? value.attr("item")() : py::object(py::str(value)))
                 .cast<std::string>();
    } else {
      raise(
          {fmt::format("the option '{}' has a value of a kind that no option takes", key.cast<std::string>()),
           "give text, a number, True or False"});
    }
    options.set(key.cast<std::string>(), std::move(text));
  }
  return options;
}

py::array view_of(const py::dtype& type, Layout layout, const void* data, const py::handle& owner) {
  py::array view(type, std::move(layout.shape), std::move(layout.strides), data, owner);
  view.attr("flags").attr("writeable") = false;
  return view;
}

py::array_t<double, py::array::c_style> rows_of_three(py::handle given, const char* what) {
  using Rows = py::array_t<double, py::array::c_style | py::array::forcecast>;
  const Rows rows =
      py::isinstance<py::array>(given) || PySequence_Check(given.ptr()) != 0 ? Rows::ensure(given) : Rows();
  PyErr_Clear();
  if (!rows || rows.ndim() != 2 || rows.shape(1) != 3 || rows.shape(0) == 0)
    raise({fmt::format("{} need an array of n rows of x, y, z", what),
           "give shape (n, 3), n at least 1; array.reshape(-1, 3) may help"});
  return py::reinterpret_borrow<py::array_t<double, py::array::c_style>>(rows);
}

std::span<const Vec3> vectors_of(const py::array_t<double, py::array::c_style>& rows) {
  static_assert(sizeof(Vec3) == 3 * sizeof(double) && alignof(Vec3) == alignof(double));
  return {reinterpret_cast<const Vec3*>(rows.data()), static_cast<std::size_t>(rows.shape(0))};
}

namespace {

// Both live as long as the interpreter.
PyTypeObject* frame_type = nullptr;
std::array<PyObject*, 3> status_names{};

std::array<PyStructSequence_Field, 6> frame_fields = {{
    {"force", "on the device, world frame, N"},
    {"god_object", "where the tip should be, world frame, mm; the HIP when free"},
    {"contact", "True in contact"},
    {"model", "index of the touched model, -1 when free"},
    {"status", "'ok'; 'bound-hit': the next frame goes on; 'non-finite': the HIP was not, no force"},
    {nullptr, nullptr},
}};

/// A tuple of three floats; null where memory ends.
PyObject* floats(const Vec3& v) {
  PyObject* const tuple = PyTuple_New(3);
  for (int axis = 0; tuple != nullptr && axis < 3; ++axis)
    PyTuple_SET_ITEM(tuple, axis, PyFloat_FromDouble(v[axis]));
  return tuple;
}

}  // namespace

void add_frame_type(py::module_& module) {
  PyStructSequence_Desc description = {"palpate.Frame", "The answer of a renderer to one place of the HIP.",
                                       frame_fields.data(), 5};
  frame_type = PyStructSequence_NewType(&description);
  if (frame_type == nullptr) throw py::error_already_set();
  module.attr("Frame") = py::reinterpret_borrow<py::object>(reinterpret_cast<PyObject*>(frame_type));
  std::size_t i = 0;
  for (const char* const name : {"ok", "bound-hit", "non-finite"})
    status_names[i++] = PyUnicode_InternFromString(name);
}

py::object frame_object(const render::Frame& frame) {
  auto object = py::reinterpret_steal<py::object>(PyStructSequence_New(frame_type));
  if (!object) throw py::error_already_set();
  PyObject* const status = status_names[static_cast<std::size_t>(frame.status)];
  Py_INCREF(status);
  PyStructSequence_SET_ITEM(object.ptr(), 0, floats(frame.force_n));
  PyStructSequence_SET_ITEM(object.ptr(), 1, floats(frame.god_object_mm));
  PyStructSequence_SET_ITEM(object.ptr(), 2, PyBool_FromLong(frame.contact ? 1 : 0));
  PyStructSequence_SET_ITEM(object.ptr(), 3, PyLong_FromLong(frame.model));
  PyStructSequence_SET_ITEM(object.ptr(), 4, status);
  return object;
}

}  // namespace palpate::python
