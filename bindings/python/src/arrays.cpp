// SPDX-License-Identifier: Apache-2.0
#include "arrays.hpp"

#include <string>

#include "dlpack.hpp"

namespace cama::python {
namespace {

/// What the receiver of a capsule owns.
template <class Tensor> struct Export {
  Tensor managed{};
  DeviceArray array;
  std::vector<std::int64_t> shape, strides;

  explicit Export(const LentArray &lent) : array(lent.array), shape(lent.shape()), strides(shape.size(), 1)
  {
    for (std::size_t d = shape.size() - 1; d > 0; --d) strides[d - 1] = strides[d] * shape[d];
    const DeviceMemory memory = array.memory();
    const bool on_host = memory.kind == DeviceMemory::Kind::host;
    dlpack::Tensor &t = managed.tensor;
    t.data = array.data();
    t.device = {on_host ? dlpack::host : dlpack::cuda, on_host ? 0 : memory.device};
    t.dimensions = static_cast<std::int32_t>(shape.size());
    t.type = {dlpack::floating, 64, 1};
    t.shape = shape.data();
    t.strides = strides.data();
    managed.context = this;
    managed.deleter = [](Tensor *m) { delete static_cast<Export *>(m->context); };
  }
};

/// Deletes what no receiver has taken from the capsule.
template <class Tensor> void drop(PyObject *capsule, const char *name)
{
  if (!PyCapsule_IsValid(capsule, name)) return;
  auto *managed = static_cast<Tensor *>(PyCapsule_GetPointer(capsule, name));
  if (managed->deleter) managed->deleter(managed);
}
void drop_unversioned(PyObject *capsule) { drop<dlpack::Managed>(capsule, dlpack::name); }
void drop_versioned(PyObject *capsule) { drop<dlpack::ManagedVersioned>(capsule, dlpack::versioned_name); }

template <class Tensor> py::object capsule_of(Export<Tensor> *given, const char *name, PyCapsule_Destructor destructor)
{
  PyObject *capsule = PyCapsule_New(&given->managed, name, destructor);
  if (!capsule) {
    delete given;
    throw py::error_already_set();
  }
  return py::reinterpret_steal<py::object>(capsule);
}

py::object to_dlpack(const LentArray &lent, bool versioned, std::uint64_t flags)
{
  if (!versioned) return capsule_of(new Export<dlpack::Managed>(lent), dlpack::name, drop_unversioned);
  auto *given = new Export<dlpack::ManagedVersioned>(lent);
  given->managed.major = dlpack::major_version;
  given->managed.minor = dlpack::minor_version;
  given->managed.flags = flags;
  return capsule_of(given, dlpack::versioned_name, drop_versioned);
}

/// Does what needs the device, alone with it.
template <class Ask> auto alone(const LentArray &lent, Ask &&ask)
{
  lent.turns->await_background();
  py::gil_scoped_release release;
  const std::lock_guard<std::mutex> lock(lent.turns->mutex);
  return ask(lent.array);
}

py::array_t<double> host_view(const LentArray &lent)
{
  py::capsule owner(new DeviceArray(lent.array), [](void *p) { delete static_cast<DeviceArray *>(p); });
  py::array_t<double> view(lent.shape(), static_cast<const double *>(lent.array.data()), owner);
  view.attr("setflags")(false);
  return view;
}

std::string type_name(const dlpack::Type &t)
{
  static const char *kinds[] = {"int", "uint", "float", "opaque", "bfloat", "complex", "bool"};
  const std::string kind = t.kind < 7 ? kinds[t.kind] : "type " + std::to_string(t.kind) + " ";
  return kind + std::to_string(t.bits) + (t.lanes == 1 ? "" : "x" + std::to_string(t.lanes));
}

}  // namespace

Received::Received(py::object capsule) : owner_(std::move(capsule))
{
  PyObject *given = owner_.ptr();
  versioned_ = PyCapsule_IsValid(given, dlpack::versioned_name) != 0;
  const char *name = versioned_ ? dlpack::versioned_name : dlpack::name;
  if (!PyCapsule_IsValid(given, name)) throw py::value_error("__dlpack__ returned no capsule that is unused");
  managed_ = PyCapsule_GetPointer(given, name);
  const auto *versioned = static_cast<const dlpack::ManagedVersioned *>(managed_);
  if (versioned_ && versioned->major != dlpack::major_version)
    throw py::value_error("__dlpack__ returned version " + std::to_string(versioned->major) + ", not 1");
  const dlpack::Tensor &t = versioned_ ? versioned->tensor : static_cast<const dlpack::Managed *>(managed_)->tensor;
  PyCapsule_SetName(given, versioned_ ? dlpack::used_versioned_name : dlpack::used_name);
  data_ = static_cast<const char *>(t.data) + t.byte_offset;
  shape_.assign(t.shape, t.shape + t.dimensions);
  type_ = type_name(t.type);
  std::int64_t step = 1;
  for (int d = t.dimensions - 1; t.strides && d >= 0; --d) {
    dense_ = dense_ && (t.shape[d] <= 1 || t.strides[d] == step);
    step *= t.shape[d];
  }
}

Received::Received(std::uintptr_t address, std::vector<std::int64_t> shape, std::string type, py::object owner)
    : owner_(std::move(owner)), data_(reinterpret_cast<const void *>(address)), shape_(std::move(shape)),
      type_(std::move(type)), in_order_(false)
{}

Received::~Received()
{
  if (versioned_) {
    auto *m = static_cast<dlpack::ManagedVersioned *>(managed_);
    if (m && m->deleter) m->deleter(m);
  } else if (managed_) {
    auto *m = static_cast<dlpack::Managed *>(managed_);
    if (m->deleter) m->deleter(m);
  }
}

DeviceVectors Received::vectors() const
{
  std::int64_t rows = shape_.size() >= 2 && shape_.back() == 3 && dense_ ? 1 : -1;
  for (std::size_t d = 0; d + 1 < shape_.size(); ++d) rows *= shape_[d];
  return {data_, rows < 0 || rows > 0x7fffffff ? -1 : static_cast<int>(rows), type_ == "float32", in_order_};
}

void bind_arrays(py::module_ &m)
{
  py::class_<LentArray>(m, "LentArray")
      .def("shape", &LentArray::shape)
      .def("address", [](const LentArray &l) { return reinterpret_cast<std::uintptr_t>(l.array.data()); })
      .def("device",
           [](const LentArray &l) {
             const DeviceMemory memory = l.array.memory();
             return std::make_pair(memory.kind == DeviceMemory::Kind::host ? dlpack::host : dlpack::cuda,
                                   memory.device);
           })
      .def("copy",
           [](const LentArray &l) {
             return LentArray{alone(l, [](const DeviceArray &a) { return a.copy(); }), l.turns, l.worlds};
           })
      .def("download",
           [](const LentArray &l) {
             return to_array<double>(alone(l, [](const DeviceArray &a) { return a.download(); }));
           })
      .def("host_view", &host_view)
      .def("dlpack", &to_dlpack);
  py::class_<Received>(m, "Received")
      .def(py::init<py::object>())
      .def(py::init<std::uintptr_t, std::vector<std::int64_t>, std::string, py::object>())
      .def("shape", &Received::shape)
      .def("type", &Received::type)
      .def("dense", &Received::dense);
}

}  // namespace cama::python
