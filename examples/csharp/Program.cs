// Takes hold of the vertex farthest from the middle of the pins, pulls it a quarter of the solid's size along y for 200
// steps, and prints where it then hangs and the force. From the root of the project, with Mono (apt-get install mono-mcs
// mono-runtime) on Linux; --platform names the system of the host:
//
//     ldsim export runs/demo --format c --platform linux-x86_64
//     cp examples/csharp/* runs/demo/export/demo-c
//     cd runs/demo/export/demo-c
//     mcs -warnaserror -out:pull.exe Program.cs Solid.cs
//     LD_LIBRARY_PATH=linux-x86_64 mono pull.exe
using System;
using System.Globalization;
using System.IO;

static class Program
{
    static void Main()
    {
        using (var model = new Model(File.ReadAllBytes("model.ldsim")))
        using (var solid = new Solid(model))
        {
            int far = Farthest(model);
            var point = new[] { solid.Positions[3 * far], solid.Positions[3 * far + 1], solid.Positions[3 * far + 2] };
            var target = new[] { point[0], point[1] + 0.25 * model.About.Diagonal, point[2] };
            uint pull = solid.Grab(point, target);
            for (int step = 0; step < 200; step++) solid.Step();
            var force = new double[3];
            solid.Force(pull, force);
            Array.Copy(solid.Positions, 3 * far, point, 0, 3);
            Console.WriteLine("vertex {0} hangs at {1} m", far, Text(point));
            Console.WriteLine("pulled with {0} N", Text(force));
        }
    }

    static int Farthest(Model model)
    {
        double[] x = model.Rest, middle = new double[3];
        double pins = 0.0, most = -1.0;
        for (int v = 0; v < model.Movable.Length; v++)
            if (model.Movable[v] == 0 && ++pins > 0)
                for (int i = 0; i < 3; i++) middle[i] += (x[3 * v + i] - middle[i]) / pins;
        int far = 0;
        for (int v = 0; v < model.Movable.Length; v++)
        {
            double away = 0.0;
            for (int i = 0; i < 3; i++) away += (x[3 * v + i] - middle[i]) * (x[3 * v + i] - middle[i]);
            if (model.Movable[v] != 0 && away > most) { most = away; far = v; }
        }
        return far;
    }

    static string Text(double[] values)
    {
        return string.Join(" ", Array.ConvertAll(values, value => value.ToString("F6", CultureInfo.InvariantCulture)));
    }
}
