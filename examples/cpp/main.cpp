// Takes hold of the vertex farthest from the middle of the pins, pulls it a quarter of the solid's size along y for 200
// steps, and prints where it then hangs and the force. From the root of the project:
//
//     ldsim export runs/demo --format c
//     cp examples/cpp/* runs/demo/export/demo-c
//     cd runs/demo/export/demo-c
//     make ldsim.o
//     g++ -std=c++17 -O2 -Wall -Wextra -Werror -o pull main.cpp ldsim.o
//     ./pull
#include "Solid.hpp"

#include <cstdio>

int main()
{
    int code = LDSIM_OK;
    const ldsim::Model model = ldsim::load("model.ldsim", code);
    if (!model) return std::fprintf(stderr, "%s\n", ldsim_message(code)), 1;
    ldsim::Solid solid(model);
    if (!solid) return std::fprintf(stderr, "%s\n", ldsim_message(LDSIM_NO_MEMORY)), 1;

    const uint32_t n = solid.info().vertices, *movable = ldsim_movable(model.get());
    ldsim::Vector middle{};
    double pins = 0.0, most = -1.0;
    for (uint32_t v = 0; v < n; v++)
        if (!movable[v] && ++pins)
            for (int i = 0; i < 3; i++) middle[i] += (solid.position(v)[i] - middle[i]) / pins;
    uint32_t far = 0, pull = 0;
    for (uint32_t v = 0; v < n; v++) {
        double away = 0.0;
        for (int i = 0; i < 3; i++) away += (solid.position(v)[i] - middle[i]) * (solid.position(v)[i] - middle[i]);
        if (movable[v] && away > most) most = away, far = v;
    }

    ldsim::Vector target = solid.position(far), force{};
    target[1] += 0.25 * solid.info().diagonal;
    code = solid.grab(solid.position(far), target, pull);
    if (code != LDSIM_OK) return std::fprintf(stderr, "%s\n", ldsim_message(code)), 1;
    for (int step = 0; step < 200; step++) solid.step();
    solid.force(pull, force);
    const ldsim::Vector x = solid.position(far);
    std::printf("vertex %u hangs at %.6f %.6f %.6f m\n", far, x[0], x[1], x[2]);
    std::printf("pulled with %.6f %.6f %.6f N\n", force[0], force[1], force[2]);
}
