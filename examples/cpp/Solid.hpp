// A solid of ldsim as a C++17 host holds it, Unreal or an engine of one's own: main.cpp says how to build and run it.
// What is made here is freed here, nothing throws but the making of an array, and a frame allocates nothing.
#pragma once
#include "ldsim.h"

#include <array>
#include <memory>
#include <utility>
#include <vector>

namespace ldsim {

using Vector = std::array<double, 3>;                // metres
using Model = std::shared_ptr<const ldsim_model>;    // read-only: any number of solids and threads may share it

/* Null where there is no such model; `why` is a code, which ldsim_message tells in words. */
inline Model load(const char *path, int &why)
{
    ldsim_model *model = nullptr;
    why = ldsim_load_file(path, &model);
    return why == LDSIM_OK ? Model(model, ldsim_free) : Model();
}

/* At rest at first, and of one thread at a time. */
class Solid {
  public:
    explicit Solid(Model model, int grabs = 4) : model_(std::move(model)), solid_(nullptr, ldsim_destroy)
    {
        ldsim_solid *made = nullptr;
        if (ldsim_create(model_.get(), grabs, &made) != LDSIM_OK) return;
        solid_.reset(made);
        ldsim_describe(model_.get(), &info_);
        rest_ = ldsim_rest(model_.get());
        positions_.resize(3 * static_cast<std::size_t>(info_.vertices));
        place();
    }
    Solid(Solid &&) noexcept = default;
    Solid &operator=(Solid &&other) noexcept
    {
        solid_ = std::move(other.solid_); // before its model goes
        model_ = std::move(other.model_), info_ = other.info_, rest_ = other.rest_;
        positions_ = std::move(other.positions_);
        return *this;
    }
    explicit operator bool() const noexcept { return solid_ != nullptr; } // false where memory was short

    const ldsim_info &info() const noexcept { return info_; }
    const std::vector<double> &positions() const noexcept { return positions_; } // (vertices, 3), filled by every step
    Vector position(std::size_t vertex) const noexcept
    {
        return {positions_[3 * vertex], positions_[3 * vertex + 1], positions_[3 * vertex + 2]};
    }

    int grab(const Vector &point, const Vector &target, uint32_t &id) noexcept
    {
        return ldsim_grab(solid_.get(), point.data(), target.data(), 0.0, 0.0, &id); // the usual stiffness and radius
    }
    int move(uint32_t id, const Vector &target) noexcept { return ldsim_move(solid_.get(), id, target.data()); }
    int release(uint32_t id) noexcept { return ldsim_release(solid_.get(), id); }
    int force(uint32_t id, Vector &newtons) const noexcept { return ldsim_force(solid_.get(), id, newtons.data()); }

    ldsim_outcome step() noexcept
    {
        const ldsim_outcome outcome = ldsim_step(solid_.get(), nullptr);
        place();
        return outcome;
    }

  private:
    void place() noexcept
    {
        ldsim_displacements(solid_.get(), positions_.data());
        for (std::size_t i = 0; i < positions_.size(); i++) positions_[i] += rest_[i];
    }

    Model model_; // outlives the solid, for members are destroyed from the last to the first
    std::unique_ptr<ldsim_solid, void (*)(ldsim_solid *)> solid_;
    ldsim_info info_{};
    const double *rest_ = nullptr;
    std::vector<double> positions_;
};

} // namespace ldsim
